//! Self-collision: rest positions follow from geometry and gravity, momentum is conserved, energy does not grow.

use super::common::*;

const SOFT: &str = "material = { stiffness = 1e3, damping = 10.0, friction_damping = 10.0, friction = 0.0 }\n";

fn folding(name: &str, parts: &[String], more: &str) -> Arc<System> {
    let toml = format!("like = \"urdf\"\nself_collision = true\ncontact = []\n{more}");
    Arc::new(System::from_text(name, &urdf(parts), Some(&toml)).expect("a robot"))
}

/// A rod along z from its joint, as a capsule.
fn rod(name: &str, mass: f64, length: f64, radius: f64) -> String {
    let (half, i) = (0.5 * length, mass * length * length / 12.0);
    let ends = [0.0, length].map(|z| collision([0.0, 0.0, z], &format!(r#"<sphere radius="{radius}"/>"#))).concat();
    let shaft = collision([0.0, 0.0, half], &format!(r#"<capsule radius="{radius}" length="{length}"/>"#));
    link(name, mass, [0.0, 0.0, half], [i, i, 0.01 * i], &(shaft + &ends))
}

fn hinge(name: &str, links: [&str; 2], at: [f64; 3], axis: &str) -> String {
    let [x, y, z] = at;
    joint(
        name,
        "continuous",
        links,
        &format!(r#"<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/><dynamics damping="0.02"/>"#),
    )
}

/// A horizontal upper arm carries a short post, and a forearm hinged to the post falls back onto the upper arm. The tip
/// rests two radii above the upper arm's axis, less the contact's deflection F / k at k = 1e3 N/m. F is half the
/// forearm's weight, less the joint torque over the tip's lever arm.
#[test]
fn a_folded_arm_rests_on_itself() {
    let parts = [
        base(),
        rod("upper", 1.0, 0.4, 0.02),
        rod("post", 0.2, 0.15, 0.02),
        rod("fore", 0.5, 0.3, 0.02),
        hinge("a", ["base", "upper"], [0.0; 3], "0 1 0"),
        hinge("b", ["upper", "post"], [0.0, 0.0, 0.4], "0 1 0"),
        hinge("c", ["post", "fore"], [0.0, 0.0, 0.15], "0 1 0"),
    ];
    let quarter = std::f64::consts::FRAC_PI_2;
    for (material, torque) in [(SOFT, 0.0), (SOFT, -0.3), (SOFT, 0.3), ("", 0.0)] {
        let system = folding("arm", &parts, &format!("floating = false\n{material}"));
        let mut batch = at(&system, "free", &[quarter, -quarter, -1.5, 0.0, 0.0, 0.0]);
        let hold = |target| Drive { kp: 1e7, kd: 1e4, target, ..Drive::default() };
        batch.drives = vec![hold(quarter), hold(-quarter), Drive::default()];
        let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
        (0..900).for_each(|_| solver.step(&mut batch, &[0.0, 0.0, torque]).expect("it can be stepped"));
        let q = batch.state(0)[2];
        // A positive torque lifts the forearm; the lever arm is the tip's horizontal distance from the joint.
        let pressed = 0.5 * 0.5 * 9.81 - torque / (0.3 * q.sin().abs());
        let (height, textbook) = (0.15 + 0.3 * q.cos(), 0.04 - if material.is_empty() { 0.0 } else { pressed / 1e3 });
        // The default material is as stiff as the substeps allow; its deflection is within the bound.
        let bound = if material.is_empty() { 5e-4 } else { 4e-5 };
        assert!((height - textbook).abs() < bound, "{torque} N m: tip at {height} m, textbook {textbook}");
        assert!(batch.state(0)[5].abs() < 1e-6, "it is not at rest: {} rad/s", batch.state(0)[5]);
    }
}

/// A trunk with two arms on skew hinges, thrown so that the arms clap and rub.
fn clapper(more: &str) -> Arc<System> {
    let parts = [
        link("trunk", 1.0, [0.0, 0.01, 0.02], [4e-3, 5e-3, 3e-3], &collision([0.0; 3], r#"<box size="0.1 0.1 0.1"/>"#)),
        rod("left", 0.3, 0.3, 0.03),
        rod("right", 0.2, 0.25, 0.02),
        hinge("l", ["trunk", "left"], [-0.1, 0.0, 0.1], "0 1 0.2"),
        hinge("r", ["trunk", "right"], [0.1, 0.02, 0.1], "0.1 1 0"),
    ];
    folding("clapper", &parts, &format!("floating = true\n{more}"))
}

/// Smallest distance (m) between two rods' axes, given as (link, length), over 61 points of each.
fn apart(batch: &Batch, links: [(&str, f64); 2]) -> f64 {
    let places = links.map(|(name, length)| {
        let pose = batch.pose(0, name).expect("a link");
        (0..=60)
            .map(|k| (pose * nalgebra::Point3::new(0.0, 0.0, length * f64::from(k) / 60.0)).coords)
            .collect::<Vec<_>>()
    });
    places[0].iter().flat_map(|a| places[1].iter().map(move |b| (a - b).norm())).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_free_body_that_claps_makes_no_energy() {
    for (damping, friction) in [(0.0, 0.0), (100.0, 0.0), (100.0, 0.6)] {
        let material = format!(
            "material = {{ stiffness = 1e5, damping = {damping:?}, friction_damping = 1e4, friction = {friction:?} }}\n"
        );
        let system = clapper(&format!("gravity = [0.0, 0.0, 0.0]\n{material}"));
        let mut start = system.default_state();
        let joints = system.robot.nq() + system.robot.root_dofs();
        start[system.robot.nq()..joints].copy_from_slice(&[0.5, -0.3, 0.8, 0.1, 0.2, -0.1]);
        start[joints..].copy_from_slice(&[2.0, -2.5]);
        let mut data = Data::new(&system.robot);
        let mut known = |state: &[f64]| totals(&system.robot, state, &mut data);
        let first = known(&start);
        for (name, substeps) in [("accurate", system.spec.substeps), ("64 substeps", 64)] {
            let (mut solver, mut batch) = (implicit(substeps), at(&system, "free", &start));
            let (mut least, mut rise, mut drift, mut nearest) = (first.kinetic, 0.0f64, 0.0f64, f64::INFINITY);
            for _ in 0..300 {
                run(&mut solver, &mut batch, 0.0, 1);
                let (now, gap) = (known(batch.state(0)), apart(&batch, [("left", 0.3), ("right", 0.25)]) - 0.05);
                nearest = nearest.min(gap);
                rise = rise.max(now.kinetic - least);
                // Energy stored in a contact may be released.
                least = if gap > 1e-3 { least.min(now.kinetic) } else { least };
                drift = drift.max((now.momentum.vector() - first.momentum.vector()).amax());
            }
            println!(
                "d = {damping}, mu = {friction}, {name}: {least:.4} of {:.4} J are left, rise {rise:.1e} J, momentum off by {drift:.1e}, gap {nearest:.4} m",
                first.kinetic
            );
            assert!((-0.02..0.002).contains(&nearest), "they meet, and stop: {nearest} m");
            assert!(rise < 1e-4 * first.kinetic, "energy rises by {rise} J");
            // While a contact lasts several substeps, the momentum error is of first order in the substep.
            assert!(drift < if substeps < 64 { 1e-4 } else { 1e-5 }, "momentum is off by {drift}");
        }
    }
}

/// Two balls on rails of a free trunk: the mass matrix is constant, so momentum changes by rounding alone.
#[test]
fn sliders_that_meet_keep_momentum() {
    let ball = |name: &str, mass: f64| {
        link(name, mass, [0.0; 3], [1e-4; 3], &collision([0.0; 3], r#"<sphere radius="0.03"/>"#))
    };
    let rail = |name: &str, child: &str, x: f64| {
        let axis = format!(
            r#"<origin xyz="{x} 0.1 0"/><axis xyz="1 0 0"/><limit lower="-5" upper="5" effort="0" velocity="100"/>"#
        );
        joint(name, "prismatic", ["trunk", child], &axis)
    };
    let parts = [
        link("trunk", 1.0, [0.0; 3], [5e-3; 3], ""),
        ball("one", 0.4),
        ball("two", 0.1),
        rail("a", "one", -0.2),
        rail("b", "two", 0.2),
    ];
    let system = folding("rails", &parts, "floating = true\ngravity = [0.0, 0.0, 0.0]\n");
    let mut start = system.default_state();
    let nq = system.robot.nq();
    start[nq + 6..].copy_from_slice(&[3.0, -2.0]);
    // The trunk's velocity cancels the total momentum, so that it does not rotate.
    start[nq + 3] = -(0.4 * 3.0 - 0.1 * 2.0) / 1.5;
    let mut data = Data::new(&system.robot);
    let first = totals(&system.robot, &start, &mut data);
    let states =
        motion(&mut Articulated::new(ArticulatedConfig::accurate(&system)), at(&system, "free", &start), 0.0, 30);
    let last = totals(&system.robot, &states[29], &mut data);
    let (off, speed) =
        ((last.momentum.vector() - first.momentum.vector()).amax(), states[29][nq + 7] - states[29][nq + 6]);
    assert!(off < 1e-10 && speed >= -1e-9 && last.kinetic <= first.kinetic, "{off:e}, {speed}, {} J", last.kinetic);
}

/// A link and its parent, and pairs that touch in the default pose, are excluded, with a note.
#[test]
fn what_touches_by_design_is_left_out() {
    let note =
        |system: &System| system.notes.iter().find(|n| n.starts_with("self_collision")).cloned().expect("a line");
    let apart = note(&clapper(""));
    assert!(apart.starts_with("self_collision of 1 pairs of links, as 3 capsules") && !apart.contains(';'), "{apart}");
    let parts = [
        link("trunk", 1.0, [0.0; 3], [4e-3; 3], ""),
        rod("left", 0.3, 0.3, 0.03),
        rod("right", 0.3, 0.3, 0.03),
        hinge("l", ["trunk", "left"], [-0.03, 0.0, 0.0], "0 1 0"),
        hinge("r", ["trunk", "right"], [0.03, 0.0, 0.0], "0 1 0"),
    ];
    let closed = note(&folding("closed", &parts, "floating = true\n"));
    assert!(
        closed.starts_with("self_collision: it has no two links") && closed.ends_with("default pose: left - right"),
        "{closed}"
    );
    // With all pairs excluded, the robot equals the one without self-collision.
    let plain = System::from_text("closed", &urdf(&parts), Some("like = \"urdf\"\nfloating = true\ncontact = []\n"))
        .expect("a robot");
    assert_eq!(plain.robot_sha256(), folding("closed", &parts, "floating = true\n").robot_sha256());
}

/// The file pairs only one geom of an arm with the trunk, the arm's parent link. The paired geom rests at the margin
/// above the trunk, although a link and its parent never meet otherwise. Without a pair, the thicker sleeve passes
/// through.
#[test]
fn what_a_file_pairs_meets_and_nothing_else() {
    let arm = |paired: &str| {
        let text = format!(
            r#"<mujoco><worldbody><body name="trunk"><freejoint/><geom name="trunk" type="box" size=".4 .1 .1" mass="50" contype="0" conaffinity="0"/>
            <body name="arm" pos="0 0 .2"><joint name="hinge" axis="0 1 0" damping=".02"/>
            <geom name="sleeve" type="sphere" pos=".2 0 0" size=".06" mass=".1" contype="0" conaffinity="0"/>
            <geom name="tip" type="sphere" pos=".3 0 0" size=".03" mass=".1" contype="0" conaffinity="0"/></body></body></worldbody>
            <contact><pair geom1="trunk" geom2="{paired}" margin=".01"/></contact></mujoco>"#
        );
        let system =
            System::from_text("arm", &text, Some("like = \"mjcf\"\nself_collision = true\n")).expect("a robot");
        let system = Arc::new(system);
        let mut batch = batch(&system, "free", 1);
        let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
        (0..600).for_each(|_| solver.step(&mut batch, &[0.3]).expect("it can be stepped"));
        batch.state(0)[7]
    };
    // The pivot is 0.1 m above the trunk.
    for (paired, lever, radius) in [("tip", 0.3, 0.03), ("sleeve", 0.2, 0.06)] {
        let (angle, expected) = (arm(paired), f64::asin((0.1 - radius - 0.01) / lever));
        assert!((angle - expected).abs() < 5e-3, "{paired}: it rests at {angle} rad, not {expected}");
    }
}
