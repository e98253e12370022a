//! The rows of a learned model, and their measurement.

use nerd_sim::{dataset::Drive, suite::Row};

use crate::prelude::*;
use crate::roll::{begun, idle, rolled};

const STARTS: usize = 32;

pub(super) struct Case {
    pub system: Arc<System>,
    pub scene: Arc<Scene>,
    pub model: PathBuf,
    pub truth: Truth,
}

pub(super) type Measure = fn(&Case, &Maker) -> Result<f64>;
pub(super) type Ask = Row<Measure>;
/// Makes the solver under test for a system like the case's.
pub(super) type Maker<'a> = dyn Fn(&Arc<System>) -> Result<Box<dyn Solver>> + 'a;

const fn ask(
    name: &'static str,
    [figure, unit]: [&'static str; 2],
    source: &'static str,
    why: &'static str,
    limit: f64,
    measure: Measure,
) -> Ask {
    Row { name, figure, unit, source, why, limit, measure }
}

/// With an error as a share of hold-last's.
const fn held(name: &'static str, why: &'static str, measure: Measure) -> Ask {
    ask(name, ["error", "of hold-last's"], "a tenth of what knowing nothing gives", why, 0.1, measure)
}

/// With a difference that may be rounding alone.
const fn same(name: &'static str, figure: &'static str, why: &'static str, measure: Measure) -> Ask {
    ask(name, [figure, ""], "rounding of f32", why, 1e-4, measure)
}

const FASTER: &str = "50 frames faster than anything in its training data.";
const PLACE: &str = "The world has no centre: what a robot does depends on what is around it.";
const FLIGHT: &str = "In the air motion is simple: nothing may be gained or lost.";

pub(super) static ASKS: [Ask; 11] = [
    held("10 frames", "As far as a controller looks ahead.", |c, m| horizon(c, m, 10)),
    held("100 frames", "The paper's horizon.", |c, m| horizon(c, m, 100)),
    held("1000 frames", "As long as an episode: is anything still known then?", |c, m| horizon(c, m, 1000)),
    ask("gone in 1000 frames", ["rollouts that left, of 32", ""], "none may", "A mean hides the one that leaves.", 0.0, gone),
    held("velocities x 1.5", FASTER, |c, m| outside(c, m, 1.5, 0.0)),
    held("velocities x 2", FASTER, |c, m| outside(c, m, 2.0, 0.0)),
    held("random torques", "50 frames driven as in its training data.", |c, m| outside(c, m, 1.0, 1.0)),
    held("torques x 2", "50 frames driven twice as hard.", |c, m| outside(c, m, 1.0, 2.0)),
    same("moved 100 km", "difference of 20 frames", PLACE, |c, m| moved(c, m, 1e5)),
    same("history", "after a reset, and after a gap, against fresh", "What it remembers must be of this motion.", history),
    ask(
        "energy in flight",
        ["change beyond the truth's in 100 frames", "of the largest kinetic"],
        "energy is the truth's",
        FLIGHT,
        0.05,
        flight,
    ),
];

fn beside(case: &Case, maker: &Maker, steps: usize) -> Result<PassiveReport> {
    let config = PassiveConfig { starts: STARTS, steps, seed: 21, action: Action::Zero };
    let (mut truth, mut solver) = (case.truth.solver(&case.system), maker(&case.system)?);
    Ok(passive(&case.system, &case.scene, &mut *truth, &mut *solver, config, &mut |_| ())?)
}

fn horizon(case: &Case, maker: &Maker, steps: usize) -> Result<f64> {
    let report = beside(case, maker, steps)?;
    Ok(report.error.iter().sum::<f64>() / report.hold.iter().sum::<f64>().max(1e-12))
}

fn gone(case: &Case, maker: &Maker) -> Result<f64> {
    Ok(beside(case, maker, 1000)?.diverged as f64)
}

/// Starts of the training box with all velocities times `factor`, driven as the training data times `drive`.
fn outside(case: &Case, maker: &Maker, factor: f64, drive: f64) -> Result<f64> {
    let (nq, joints) = (case.system.robot.nq(), case.system.robot.joint_count());
    let mut batch = starts(&case.system, &case.scene);
    for env in 0..STARTS {
        batch.state_mut(env)[nq..].iter_mut().for_each(|v| *v *= factor);
    }
    let (first, mut real, mut solvers) = (batch.clone(), batch.clone(), (case.truth.solver(&case.system), maker(&case.system)?));
    let (mut rng, mut source, mut torques) = (stream(23, 0), Drive::new(&case.system), vec![0.0; STARTS * joints]);
    let (mut error, mut hold) = (0.0, 0.0);
    for _ in 0..50 {
        for env in 0..STARTS {
            source.draw(real.state(env), drive, &mut rng, &mut torques[env * joints..(env + 1) * joints]);
        }
        solvers.0.step(&mut real, &torques)?;
        solvers.1.step(&mut batch, &torques)?;
        error += distance(&case.system, &real, &batch);
        hold += distance(&case.system, &real, &first);
    }
    Ok(error / hold.max(1e-12))
}

/// The world moved along x: the robot's base or pose, and every collider.
fn moved(case: &Case, maker: &Maker, by: f64) -> Result<f64> {
    let by = Vector3::new(by, 0.0, 0.0);
    let mut system = (*case.system).clone();
    let mut scene = (*case.scene).clone();
    for collider in &mut scene.colliders {
        collider.pose.translation.vector += by;
        collider.plane.iter_mut().for_each(|p| p.offset += p.normal.dot(&by));
    }
    if let Base::Fixed(pose) = &mut system.robot.base {
        pose.translation.vector += by;
    }
    let (here, system) = (starts(&case.system, &case.scene), Arc::new(system));
    let scene = Arc::new(scene);
    let mut there = Batch { system: system.clone(), scenes: vec![scene; STARTS], ..here.clone() };
    shift(&mut there, &by);
    let (here, mut there) = (rolled(here, &mut *maker(&case.system)?, 20)?, rolled(there, &mut *maker(&system)?, 20)?);
    shift(&mut there, &-by);
    Ok(here.states.iter().zip(&there.states).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max))
}

/// Moves floating robots: `p += by`, and the twist about the world's origin keeps its velocity, `v += by x w`.
fn shift(batch: &mut Batch, by: &Vector3<f64>) {
    let (nq, floating) = (batch.system.robot.nq(), batch.system.robot.floating());
    for env in (0..batch.len()).filter(|_| floating) {
        let state = batch.state_mut(env);
        let w = Vector3::from_column_slice(&state[nq..nq + 3]);
        let moment = by.cross(&w);
        for k in 0..3 {
            state[k] += by[k];
            state[nq + 3 + k] += moment[k];
        }
    }
}

fn history(case: &Case, maker: &Maker) -> Result<f64> {
    let fresh = rolled(starts(&case.system, &case.scene), &mut *maker(&case.system)?, 15)?;
    let gap = |batch: Batch| fresh.states.iter().zip(&batch.states).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    // Reset.
    let mut solver = maker(&case.system)?;
    rolled(starts(&case.system, &case.scene), &mut *solver, 12)?;
    (0..STARTS).for_each(|env| solver.reset(env));
    let reset = rolled(starts(&case.system, &case.scene), &mut *solver, 15)?;
    // Not reset: another solver steps some frames in between, then the start is put back by hand.
    let mut solver = maker(&case.system)?;
    let begun = rolled(starts(&case.system, &case.scene), &mut *solver, 5)?;
    let mut skipped = rolled(begun, &mut *case.truth.solver(&case.system), 3)?;
    skipped.states.clone_from(&starts(&case.system, &case.scene).states);
    let skipped = rolled(skipped, &mut *solver, 15)?;
    Ok(gap(reset).max(gap(skipped)))
}

fn flight(case: &Case, maker: &Maker) -> Result<f64> {
    let free = Arc::new(Scene::free(case.scene.gravity));
    let (mut real, mut made) = (starts(&case.system, &free), starts(&case.system, &free));
    let (mut truth, mut solver) = (case.truth.solver(&case.system), maker(&case.system)?);
    let torques = idle(&real);
    let mut data = Data::new(&case.system.robot);
    let (mut worst, mut kinetic) = (vec![0.0f64; STARTS], vec![1e-9f64; STARTS]);
    for _ in 0..100 {
        truth.step(&mut real, &torques)?;
        solver.step(&mut made, &torques)?;
        for env in 0..STARTS {
            let [a, b] = [&real, &made].map(|batch| totals(&case.system.robot, batch.state(env), &mut data));
            worst[env] = worst[env].max((a.energy(&free.gravity) - b.energy(&free.gravity)).abs());
            kinetic[env] = kinetic[env].max(a.kinetic);
        }
    }
    let shares = worst.iter().zip(&kinetic).map(|(w, k)| w / k);
    Ok(shares.sum::<f64>() / STARTS as f64)
}

fn starts(system: &Arc<System>, scene: &Arc<Scene>) -> Batch {
    begun(system, scene, STARTS, Start::Sample, 24)
}

/// Mean |difference| of positions, endless angles wrapped.
fn distance(system: &System, a: &Batch, b: &Batch) -> f64 {
    let (d, nq, coords) = (system.robot.state_dim(), system.robot.nq(), system.robot.root_coords());
    let wraps: Vec<bool> = system.robot.joints().map(|j| j.wraps()).collect();
    let gap = |(i, (a, b)): (usize, (&f64, &f64))| {
        let turns = i % d >= coords && wraps[i % d - coords];
        if turns { nerd_core::state::wrap(a - b).abs() } else { (a - b).abs() }
    };
    a.states.iter().zip(&b.states).enumerate().filter(|(i, _)| i % d < nq).map(gap).sum()
}
