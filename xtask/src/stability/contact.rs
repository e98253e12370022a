//! Rows of contact and friction: one body on one plane.

use nalgebra::Vector3;
use nerd_core::state::{quaternion, vector};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

use super::row::Row;
use super::trial::{Fault::*, Motion, Trial};
use super::worlds::Body;

const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];
const G: f64 = 9.81;

pub const ROWS: [Row; 18] = [
    Row {
        name: "rest",
        figure: "distance from where it must lie after 5 s (m)",
        source: "m g / 4 k below the surface",
        limit: 1e-3,
        reddens: &[NoFloor],
        measure: rest,
    },
    Row {
        name: "restitution",
        figure: "error of rebound / drop height, two dampings",
        source: "spring and damper's closed form e^2; 0.05 of rapier's tests",
        limit: 0.05,
        reddens: &[NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: restitution,
    },
    Row {
        name: "stopping distance",
        figure: "error, mu 0.2 0.4 0.7 (relative)",
        source: "Newton tests; v^2 / 2 mu g",
        limit: 0.05,
        reddens: &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: stopping,
    },
    Row {
        name: "friction threshold",
        figure: "slip below the angle, or 2 cm / slip above it (2 cm)",
        source: "Newton tests; tan a = mu, mu 0.5, slopes 10 20 24, 29 35 40 deg, 0.5 s",
        limit: 1.0,
        reddens: &[NoFloor, DroppedVelocity, FrozenWorld],
        measure: threshold,
    },
    Row {
        name: "sliding down",
        figure: "error of the way, 35 deg, mu 0.5, 1 s (relative)",
        source: "g (sin a - mu cos a) t^2 / 2",
        limit: 0.05,
        reddens: &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: sliding,
    },
    Row {
        name: "plate at four yaws",
        figure: "a plate: spread of way, lateral way, yaw (relative)",
        source: "Coulomb's cone is round",
        limit: 0.02,
        reddens: &[NoFloor, DroppedVelocity, FrozenWorld, HalfGravity, PumpedVelocity],
        measure: |trial| yaws(trial, plate(), 0.05),
    },
    Row {
        name: "cube at four yaws",
        figure: "a cube: spread of way, lateral way, yaw (relative)",
        source: "Coulomb's cone is round",
        limit: 0.02,
        reddens: &[NoFloor, DroppedVelocity, FrozenWorld, HalfGravity, PumpedVelocity],
        measure: |trial| yaws(trial, Body::default(), 0.1),
    },
    Row {
        name: "table at four yaws",
        figure: "a table of four round feet: spread of way, lateral way, yaw (relative)",
        source: "Coulomb's cone is round",
        limit: 0.02,
        reddens: &[NoFloor, DroppedVelocity, FrozenWorld, HalfGravity, PumpedVelocity],
        measure: |trial| yaws(trial, table(), 0.27),
    },
    Row {
        name: "rolling ball",
        figure: "error of the speed, 15 deg, 1 s (relative)",
        source: "Drake's scene; 5/7 g sin a t",
        limit: 5e-3,
        reddens: &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: rolling,
    },
    Row {
        name: "tossed cube",
        figure: "gain of energy over 2 s of tumbling (relative)",
        source: "contact is passive",
        limit: 1e-3,
        reddens: &[PumpedVelocity],
        measure: toss,
    },
    Row {
        name: "stiff ground",
        figure: "speed after a landing on k = 1e7 N/m (of the impact's)",
        source: "contact is passive",
        limit: 1.05,
        reddens: &[NoFloor, PumpedVelocity],
        measure: stiff,
    },
    Row {
        name: "tip into ground",
        figure: "gain of energy, pendulum at 7 rad/s (relative)",
        source: "contact is passive",
        limit: 0.01,
        reddens: &[PumpedVelocity],
        measure: |trial| tip(trial, 1.0),
    },
    Row {
        name: "heavy tip",
        figure: "gain of energy, the same, tip mass x 1e4 (relative)",
        source: "contact is passive",
        limit: 0.01,
        reddens: &[HalfGravity, PumpedVelocity],
        measure: |trial| tip(trial, 1e4),
    },
    Row {
        name: "light tip",
        figure: "gain of energy, the same, tip mass x 1e-4 (relative)",
        source: "contact is passive",
        limit: 0.01,
        reddens: &[HalfGravity, PumpedVelocity],
        measure: |trial| tip(trial, 1e-4),
    },
    Row {
        name: "under terrain",
        figure: "depth 1 s after a start 3 cm under hills (m)",
        source: "a surface pushes out; m g / k is 1 mm",
        limit: 0.005,
        reddens: &[NoFloor, FrozenWorld],
        measure: under,
    },
    Row {
        name: "pendulum self-convergence",
        figure: "against four times the substeps, ground, 1 s, 4 starts (rad)",
        source: "a tenth of the paper's error of a learned pendulum, 0.012 rad",
        limit: 1.2e-3,
        reddens: &[DroppedVelocity, FrozenWorld],
        measure: |trial| against_finer(trial, "pendulum", "ground1"),
    },
    Row {
        name: "Ant self-convergence",
        figure: "against four times the substeps, dropped, 1 s, 4 starts (rad)",
        source: "a tenth of the paper's error of a learned Ant, 0.047 rad",
        limit: 4.7e-3,
        reddens: &[DroppedVelocity, FrozenWorld],
        measure: |trial| against_finer(trial, "ant", "ground"),
    },
    Row {
        name: "Markov",
        figure: "a motion against its second half begun afresh, or after a reset (rad)",
        source: "the next state is a function of the present one",
        limit: 1e-12,
        reddens: &[HiddenClock],
        measure: markov,
    },
];

/// A plate of 0.4 x 0.4 x 0.1 m and 1 kg.
fn plate() -> Body {
    let (a, b) = ((0.16 + 0.01) / 12.0, 0.32 / 12.0);
    Body { shape: r#"<box size="0.4 0.4 0.1"/>"#.into(), inertia: [a, a, b], ..Default::default() }
}

fn rest(trial: &Trial) -> Result<f64, String> {
    let body = Body::default();
    let motion = trial.passive(&body.system()?, "ground", &Body::state([0.0, 0.0, 0.1], UPRIGHT, [0.0; 3], [0.0; 3]), 300)?;
    // A box's corners have a radius of 1e-5 m.
    let depth = if trial.compliant() { body.mass * G / (4.0 * body.material[0]) } else { 0.0 };
    Ok((vector(motion.last()) - Vector3::new(0.0, 0.0, 0.1 + 1e-5 - depth)).norm())
}

fn restitution(trial: &Trial) -> Result<f64, String> {
    let mut worst = 0.0f64;
    for damping in [10.0, 40.0] {
        let body = Body {
            shape: r#"<sphere radius="0.05"/>"#.into(),
            inertia: [1e-3; 3],
            material: [1e4, damping, 1e3, 0.5],
            ..Default::default()
        };
        let motion = trial.passive(&body.system()?, "ground", &Body::state([0.0, 0.0, 1.05], UPRIGHT, [0.0; 3], [0.0; 3]), 90)?;
        let z: Vec<f64> = motion.states.iter().map(|s| s[2] - 0.05).collect();
        let landed = z.windows(2).position(|w| w[1] > w[0]).unwrap_or(z.len() - 1);
        let rebound = z[landed..].iter().fold(0.0f64, |a, b| a.max(*b));
        // Damped on the way in, undamped on the way out.
        let zeta = damping / (2.0 * (body.mass * 1e4f64).sqrt());
        let e = (-zeta * zeta.acos() / (1.0 - zeta * zeta).sqrt()).exp();
        worst = worst.max((rebound - e * e).abs());
    }
    Ok(worst)
}

fn stopping(trial: &Trial) -> Result<f64, String> {
    let mut worst = 0.0f64;
    for mu in [0.2, 0.4, 0.7] {
        let body = Body { material: [1e4, 100.0, 1e3, mu], ..plate() };
        let motion = trial.passive(&body.system()?, "ground", &Body::state([0.0, 0.0, 0.05], UPRIGHT, [0.0; 3], [2.0, 0.0, 0.0]), 90)?;
        worst = worst.max((motion.last()[0] / (4.0 / (2.0 * mu * G)) - 1.0).abs());
    }
    Ok(worst)
}

/// Way down a slope in `frames` frames from rest (m).
fn down(trial: &Trial, body: Body, degrees: f64, height: f64, frames: usize) -> Result<(f64, f64), String> {
    let slope = degrees.to_radians();
    let body = Body { slope, ..body };
    let (s, c) = slope.sin_cos();
    let q = [0.0, (0.5 * slope).sin(), 0.0, (0.5 * slope).cos()];
    let start = Body::state([s * height, 0.0, c * height], q, [0.0; 3], [0.0; 3]);
    let motion = trial.passive(&body.system()?, "ground", &start, frames)?;
    let along = Vector3::new(c, 0.0, -s);
    let last = motion.last();
    let velocity = vector(&last[10..]) + vector(&last[7..]).cross(&vector(last));
    Ok((along.dot(&(vector(last) - vector(&start))), along.dot(&velocity)))
}

fn threshold(trial: &Trial) -> Result<f64, String> {
    let mut worst = 0.0f64;
    for degrees in [10.0, 20.0, 24.0, 29.0, 35.0, 40.0] {
        let slip = down(trial, plate(), degrees, 0.05, 30)?.0.abs() / 0.02;
        worst = worst.max(if degrees < 26.0 { slip } else { (1.0 / slip).min(1e3) });
    }
    Ok(worst)
}

fn sliding(trial: &Trial) -> Result<f64, String> {
    let a = 35f64.to_radians();
    Ok((down(trial, plate(), 35.0, 0.05, 60)?.0 / (0.5 * G * (a.sin() - 0.5 * a.cos())) - 1.0).abs())
}

fn rolling(trial: &Trial) -> Result<f64, String> {
    let ball = Body { shape: r#"<sphere radius="0.1"/>"#.into(), inertia: [0.004; 3], ..Default::default() };
    Ok((down(trial, ball, 15.0, 0.1, 60)?.1 / (5.0 / 7.0 * G * 15f64.to_radians().sin()) - 1.0).abs())
}

/// A table of 1 kg: its middle 0.27 m above the ground, on four feet 0.6 by 0.4 m apart.
fn table() -> Body {
    Body { feet: Some([0.3, 0.2, 0.25]), inertia: [0.03, 0.05, 0.07], ..Default::default() }
}

fn yaws(trial: &Trial, body: Body, height: f64) -> Result<f64, String> {
    let system = Body { material: [1e4, 100.0, 1e3, 0.4], ..body }.system()?;
    let (mut ways, mut worst) = (Vec::new(), 0.0f64);
    for degrees in [0.0f64, 15.0, 30.0, 45.0] {
        let half = 0.5 * degrees.to_radians();
        let q = [0.0, 0.0, half.sin(), half.cos()];
        let motion = trial.passive(&system, "ground", &Body::state([0.0, 0.0, height], q, [0.0; 3], [2.0, 0.0, 0.0]), 60)?;
        let last = motion.last();
        let yaw = quaternion(&last[3..7]).angle_to(&quaternion(&q));
        worst = worst.max(last[1].abs() / last[0].abs().max(1e-3)).max(yaw);
        ways.push(last[0]);
    }
    let (low, high) = ways.iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
    // Something must have slid, and stopped.
    let expected = 4.0 / (2.0 * 0.4 * G);
    Ok(if (low / expected - 1.0).abs() > 0.5 { 1.0 } else { worst.max((high - low) / high) })
}

fn toss(trial: &Trial) -> Result<f64, String> {
    let start = Body::state([0.0, 0.0, 0.5], [0.2, 0.1, 0.3, 0.927], [6.0, -3.0, 2.0], [1.0, 0.5, 0.0]);
    gain(trial, &Body::default().system()?, "ground", &start, 120)
}

fn tip(trial: &Trial, times: f64) -> Result<f64, String> {
    let mut system = (*System::named("pendulum").map_err(|e| e.to_string())?).clone();
    let tip = &mut system.robot.links[1].inertia;
    (tip.mass, tip.inertia) = (times * tip.mass, times * tip.inertia);
    gain(trial, &std::sync::Arc::new(system), "ground1", &[0.0, 0.0, -7.0, 0.0], 120)
}

/// Largest gain of energy over that of the start, against the start's kinetic energy.
fn gain(trial: &Trial, system: &std::sync::Arc<System>, scene: &str, start: &[f64], frames: usize) -> Result<f64, String> {
    let motion = trial.passive(system, scene, start, frames)?;
    let (e, first) = (motion.energies(), motion.totals()[0].kinetic);
    Ok(e.iter().map(|x| (x - e[0]) / first).fold(0.0, f64::max))
}

fn stiff(trial: &Trial) -> Result<f64, String> {
    let body =
        Body { shape: r#"<sphere radius="0.05"/>"#.into(), inertia: [1e-3; 3], material: [1e7, 100.0, 1e3, 0.5], ..Default::default() };
    let motion = trial.passive(&body.system()?, "ground", &Body::state([0.0, 0.0, 0.55], UPRIGHT, [0.0; 3], [0.0; 3]), 60)?;
    let speeds = motion.states.iter().map(|s| (vector(&s[10..]) + vector(&s[7..]).cross(&vector(s))).norm());
    Ok(speeds.fold(0.0, f64::max) / (2.0 * G * 0.5).sqrt())
}

fn markov(trial: &Trial) -> Result<f64, String> {
    let system = System::named("pendulum").map_err(|e| e.to_string())?;
    let whole = trial.passive(&system, "ground1", &[1.0, 0.5, 0.0, 0.0], 80)?;
    let fresh = trial.passive(&system, "ground1", &whole.states[40], 40)?;
    let reset = trial.after_reset(&system, "ground1", &[-1.0, 1.0, 3.0, -2.0], &whole.states[40], 40)?;
    let gap = |half: &Motion| whole.last().iter().zip(half.last()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    Ok(gap(&fresh).max(gap(&reset)))
}

fn under(trial: &Trial) -> Result<f64, String> {
    let ball = Body { shape: r#"<sphere radius="0.05"/>"#.into(), inertia: [1e-3; 3], ..Default::default() };
    let (system, x, y) = (ball.system()?, 1.0, 2.0);
    let start = Body::state([x, y, nerd_sim::worlds::hill(x, y) - 0.03 + 0.05], UPRIGHT, [0.0; 3], [0.0; 3]);
    let motion = trial.passive(&system, "hills", &start, 60)?;
    let event = system.scene("hills").map_err(|e| e.to_string())?.contact(&vector(motion.last()));
    Ok((0.05 - event.distance).max(0.0))
}

/// Mean |dq| at the end of a second between a method and itself with four times the substeps; 1 if from some start no
/// coordinate moved by 0.3 rad or m, a fall's least being 0.5.
fn against_finer(trial: &Trial, robot: &str, scene: &str) -> Result<f64, String> {
    let system = System::named(robot).map_err(|e| e.to_string())?;
    let (nq, starts) = (system.robot.nq(), 4);
    let mut sum = 0.0;
    for seed in 0..starts {
        let state = start(&system, Start::Reset, &mut stream(17, seed));
        let (a, b) = (trial.passive(&system, scene, &state, 60)?, trial.finer(&system, scene, &state, 60)?);
        let moved = a.last()[..nq].iter().zip(&state).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if moved < 0.3 {
            return Ok(1.0);
        }
        sum += a.last()[..nq].iter().zip(&b.last()[..nq]).map(|(a, b)| (a - b).abs()).sum::<f64>();
    }
    Ok(sum / (starts as usize * nq) as f64)
}
