//! Rows of round bodies: a rolling wheel, a wobbling coin, a can that stands or tips.

use std::f64::consts::{FRAC_PI_2, PI};

use super::*;

pub(super) const ROWS: &[Row] = &[
    row(
        "wheel",
        "way of a wheel, 1 m/s, 5 s",
        "relative",
        0.01,
        "rolling without slip does no work",
        "A wheel of a few fixed points is a polygon, which stands after a third of a second.",
        wheel,
    ),
    row(
        "wobbling coin",
        "rate of precession, 30 degrees, 5 s",
        "relative",
        0.01,
        "W^2 = 4 g / (R sin a), more exactly with the coin's thickness",
        "The touching place runs round the rim: friction that is off by half a substep drives the coin.",
        coin,
    ),
    row(
        "leaning can",
        "lean of a can let go short of its edge and beyond",
        "rad",
        0.01,
        "it tips beyond atan(2 R / L)",
        "Three points a rim are as stiff in all directions, so that a can stands still and lies flat.",
        can,
    ),
];

/// Makes a cylinder along z of 1 kg and uniform density, with `[radius, length]` (m).
fn cylinder([radius, length]: [f64; 2], material: [f64; 4]) -> Result<Arc<System>> {
    let along = 0.5 * radius * radius;
    let across = radius * radius / 4.0 + length * length / 12.0;
    let shape = format!(r#"<cylinder radius="{radius}" length="{length}"/>"#);
    Ok(Body { shape, inertia: [across, across, along], material, ..Default::default() }.system()?)
}

fn leaning(angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle)
}

fn axis(state: &[f64]) -> Vector3<f64> {
    quaternion(&state[3..7]) * Vector3::z()
}

fn wheel(trial: &Trial) -> Result<f64> {
    let system = cylinder([0.1, 0.04], [1e4, 100.0, 1e3, 0.5])?;
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2).coords.into();
    let high = 0.1 + 1e-5 - if trial.method.rigid { 0.0 } else { GRAVITY / 2e4 };
    let start = Body::state([0.0, 0.0, high], upright, [0.0, 10.0, 0.0], [1.0, 0.0, 0.0]);
    let motion = trial.passive(&system, "ground", &start, 300)?;
    let last = motion.last();
    Ok((last[0] / 5.0 - 1.0).abs().max(last[1].abs()).max((last[2] / high - 1.0).abs()))
}

/// A coin at angle a from the ground precesses at the rate W (rad/s), its centre at rest. The coin rotates about the
/// line from its centre to the contact, `r = -R t - l n`. t points up the coin's face, n is its axis; R is its radius,
/// l half its thickness. `d/dt L = r x m g` gives `W^2 sin a (I_t cos a - I_n l / R sin a) = m g (R cos a - l sin a)`.
fn coin(trial: &Trial) -> Result<f64> {
    let radius = 0.1;
    let half = 0.001;
    let a = PI / 6.0;
    let system = cylinder([radius, 2.0 * half], [1e5, 100.0, 1e4, 0.5])?;
    let [across, _, along] = [0, 1, 2].map(|k| system.robot.links[0].inertia.inertia[(k, k)]);
    let arm = GRAVITY * (radius * a.cos() - half * a.sin());
    let rate = (arm / (a.sin() * (across * a.cos() - along * half / radius * a.sin()))).sqrt();
    let up = Vector3::new(-a.cos(), 0.0, a.sin());
    let out = leaning(a) * Vector3::z();
    let spin = (up * radius + out * half) * (rate * a.sin() / radius);
    let height = radius * a.sin() + half * a.cos() - GRAVITY / 1e5;
    let start = Body::state([0.0, 0.0, height], leaning(a).coords.into(), spin.into(), [0.0; 3]);
    let motion = trial.passive(&system, "ground", &start, 300)?;
    let mut turned = 0.0;
    let mut before = 0.0f64;
    for now in motion.states.iter().map(|s| axis(s).y.atan2(axis(s).x)) {
        turned += (now - before + PI).rem_euclid(2.0 * PI) - PI;
        before = now;
    }
    Ok((turned / (5.0 * rate) - 1.0).abs())
}

fn can(trial: &Trial) -> Result<f64> {
    let [radius, length] = [0.03, 0.1];
    let system = cylinder([radius, length], [1e4, 50.0, 1e3, 0.5])?;
    let edge = (2.0 * radius / length).atan();
    worst([(0.0, 0.0), (0.8 * edge, 0.0), (1.2 * edge, FRAC_PI_2)], |(lean, rests): (f64, f64)| {
        let height = 0.5 * length * lean.cos() + radius * lean.sin();
        let start = Body::state([0.0, 0.0, height], leaning(lean).coords.into(), [0.0; 3], [0.0; 3]);
        let motion = trial.passive(&system, "ground", &start, 300)?;
        Ok((axis(motion.last()).angle(&Vector3::z()) - rests).abs())
    })
}
