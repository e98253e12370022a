//! `articulated`, preset `paper`, against trajectories of the reference simulator (f32), read from
//! `../shared/reference` beside the checkout when it is there.
//!
//! Bounds: the reference computes in f32, so single steps differ by about 1e-7. A hundred steps differ by 1e-6 to 1e-4
//! (chaotic near contact). A wrong term shows at 1e-2 and above.

mod common;

use common::*;

/// Rows of one trajectory: states and torques by step.
#[derive(Default)]
struct Trajectory {
    states: Vec<Vec<f64>>,
    torques: Vec<Vec<f64>>,
}

fn read(file: &str, system: &System) -> Option<Vec<Trajectory>> {
    let table = Reference::read(file)?;
    let (step, states) = (table.places(&["step"])[0], table.places(&system.spec.state_columns));
    let torques: Vec<usize> = (0..table.columns.len()).filter(|i| table.columns[*i].starts_with("tau")).collect();
    let mut out: Vec<Trajectory> = Vec::new();
    for row in &table.rows {
        let numbers = |places: &[usize]| places.iter().map(|i| row[*i].unwrap_or(0.0)).collect::<Vec<_>>();
        if numbers(&[step]) == [0.0] {
            out.push(Trajectory::default());
        }
        let last = out.last_mut().expect("step 0 comes first");
        last.states.push(numbers(&states));
        let tau = if torques.is_empty() { vec![0.0; system.robot.joint_count()] } else { numbers(&torques) };
        last.torques.push(tau);
    }
    // The file can also be read as a table of rollouts.
    #[cfg(feature = "csv")]
    if !system.robot.floating() {
        use nerd_sim::rollout;
        let own = rollout::States::read(&Reference::path(file), system).expect("read as it is");
        assert!(
            own.trajectories.values().map(|t| &t.start).eq(out.iter().map(|t| &t.states[0])),
            "{file}: other starts"
        );
        let same = |(own, t): (&rollout::Trajectory, &Trajectory)| own.torques(0) == Some(&t.torques[0][..]);
        assert!(!own.driven || own.trajectories.values().zip(&out).all(same), "{file}: other torques");
    }
    Some(out)
}

/// Largest |difference| over the coordinates of q (m or rad, an orientation by its angle) after `steps` frames, one for
/// each trajectory of the file. `nudge` shifts one coordinate of all starts. `None` without the file.
fn drift(
    file: &str,
    robot: &str,
    scene: &str,
    friction: Friction,
    steps: usize,
    nudge: Option<(usize, f64)>,
) -> Option<Vec<f64>> {
    let system = built_in(robot);
    let mut trajectories = read(file, &system)?;
    if let Some((coordinate, by)) = nudge {
        trajectories.iter_mut().for_each(|t| t.states[0][coordinate] += by);
    }
    let mut batch = batch(&system, scene, trajectories.len());
    trajectories.iter().enumerate().for_each(|(env, t)| batch.reset(env, &t.states[0]));
    let mut solver = Articulated::new(ArticulatedConfig::paper(&system, friction));
    for step in 0..steps {
        let torques: Vec<f64> = trajectories.iter().flat_map(|t| t.torques[step].clone()).collect();
        solver.step(&mut batch, &torques).expect("finite");
    }
    let (coords, nq) = (system.robot.root_coords(), system.robot.nq());
    let wraps: Vec<bool> = system.robot.joints().map(|j| j.wraps()).collect();
    let gap = |env: usize| {
        let (ours, theirs) = (batch.state(env), &trajectories[env].states[steps]);
        let joints =
            (coords..nq).map(|k| if wraps[k - coords] { wrap(ours[k] - theirs[k]) } else { ours[k] - theirs[k] });
        let place = (0..coords.min(3)).map(|k| ours[k] - theirs[k]);
        let turn = (coords > 0).then(|| quaternion(&ours[3..7]).angle_to(&quaternion(&theirs[3..7])));
        joints.chain(place).chain(turn).map(f64::abs).fold(0.0, f64::max)
    };
    Some((0..trajectories.len()).map(gap).collect())
}

/// Median and largest, which are printed.
fn spread(name: &str, mut drifts: Vec<f64>) -> [f64; 2] {
    drifts.sort_by(f64::total_cmp);
    let spread = [drifts[drifts.len() / 2], drifts[drifts.len() - 1]];
    println!("{name}: median {:.2e}, largest {:.2e} rad or m", spread[0], spread[1]);
    spread
}

#[test]
fn contact_free_trajectories_are_reproduced_to_1e_4_at_step_100() {
    for (name, robot) in [
        ("cartpole_passive", "cartpole-paper"),
        ("cartpole_random_torque", "cartpole-paper"),
        ("pendulum_passive_config0", "pendulum-paper"),
        ("pendulum_random_torque_config0", "pendulum-paper"),
    ] {
        for file in ["1.5.1", "1.8.1"].map(|version| format!("{name}_warp{version}.csv")) {
            let Some(drifts) = drift(&file, robot, "free", Friction::Coulomb, 100, None) else { return };
            let [_, largest] = spread(&file, drifts);
            assert!(largest < 1e-4, "{file}: {largest:.2e} rad or m at step 100, bound 1e-4");
        }
    }
}

#[test]
fn contact_trajectories_with_coulomb_friction_are_reproduced() {
    let mut all = Vec::new();
    for ground in 1..=6 {
        let (file, scene) = (format!("pendulum_passive_config{ground}_warp1.5.1.csv"), format!("ground{ground}"));
        let Some(drifts) = drift(&file, "pendulum-paper", &scene, Friction::Coulomb, 100, None) else { return };
        spread(&scene, drifts.clone());
        all.extend(drifts);
    }
    let [median, largest] = spread("all grounds", all);
    assert!(median < 1e-5, "median {median:.2e} rad at step 100, bound 1e-5");
    assert!(largest < 1e-3, "largest {largest:.2e} rad at step 100, bound 1e-3");
}

#[test]
fn the_friction_laws_are_told_apart() {
    let median = |law| {
        let drifts = drift("pendulum_passive_config1_warp1.8.1.csv", "pendulum-paper", "ground1", law, 100, None)?;
        Some(spread(&format!("1.8.1, {law:?}"), drifts)[0])
    };
    let (Some(huber), Some(coulomb)) = (median(Friction::Huber), median(Friction::Coulomb)) else { return };
    // Near rest the Huber force jumps, in f32 and f64 at different substeps; drifts are then about 1e-3.
    assert!(huber < 1e-3 && coulomb > 10.0 * huber, "Huber {huber:.2e}, Coulomb {coulomb:.2e}");
}

/// Bounds on the largest drift at step 60 of the robots in three dimensions, each in the version that has its law.
///
/// The damper of a joint limit sets in with a jump. A trajectory may enter or leave a limit within the reference's f32
/// noise of a substep's end. Any other arithmetic then follows another path. In such a case a start 3e-6 m away keeps
/// to the reference. One trajectory of the 52 is such a case.
#[test]
fn robots_in_space_are_reproduced_to_step_60() {
    use Friction::{Coulomb, Huber};
    let mut flipped = 0;
    for (name, robot, scene, friction, bound) in [
        ("franka_random_torque_warp1.8.1", "franka-paper", "free", Coulomb, 1e-4),
        ("franka_pd_random_action_warp1.8.1", "franka-paper", "free", Coulomb, 1e-4),
        ("ant_passive_warp1.5.1", "ant-paper", "ground", Coulomb, 1e-3),
        ("ant_random_torque_warp1.5.1", "ant-paper", "ground", Coulomb, 1e-3),
        ("ant_passive_warp1.8.1", "ant-paper", "ground", Huber, 1e-3),
        ("ant_random_torque_warp1.8.1", "ant-paper", "ground", Huber, 1e-3),
        ("cube_toss_warp1.5.1", "cube-paper", "ground", Coulomb, 1e-3),
        ("anymal_zero_action_warp1.8.1", "anymal-paper", "ground", Huber, 1e-3),
        ("anymal_random_action_warp1.8.1", "anymal-paper", "ground", Huber, 1e-3),
    ] {
        let drifts = |nudge| drift(&format!("{name}.csv"), robot, scene, friction, 60, nudge);
        let Some(found) = drifts(None) else { return };
        println!("{name}: {}", found.iter().map(|d| format!("{d:.1e}")).collect::<Vec<_>>().join(" "));
        for trajectory in (0..found.len()).filter(|&t| found[t] >= bound) {
            let nudges = (0..3).flat_map(|k| [(k, 3e-6), (k, -3e-6)]);
            let near = nudges.filter_map(|nudge| Some(drifts(Some(nudge))?[trajectory])).fold(f64::INFINITY, f64::min);
            println!(
                "  trajectory {trajectory} leaves at a limit: {:.1e}, from a start 3e-6 m away {near:.1e}",
                found[trajectory]
            );
            assert!(near < bound, "{name}: {:.2e} rad or m at step 60, bound {bound:.0e}", found[trajectory]);
            flipped += 1;
        }
    }
    assert!(flipped <= 1, "{flipped} trajectories leave the reference at a limit, one is known");
}
