//! Rows of contact (rest, rebounds, impacts) and of friction (a body that slides or rolls).

use super::*;

pub(super) static LANDING: [Row; 2] = [
    Row::new("rest", "distance from where it must lie after 5 s", "m", 1e-3, rest)
        .source("m g / 4 k below the surface")
        .why("A body left alone lies still, as deep as its springs say: it does not creep, sink or tremble."),
    Row::new("restitution", "error of rebound / drop height, two dampings", "", 0.05, restitution)
        .source("spring and damper's closed form e^2; 0.05 of rapier's tests")
        .why("The damper decides how high a ball bounces; a step that looks too far ahead swallows the bounce."),
];

pub(super) static PASSIVE: [Row; 6] = [
    Row::new("tossed cube", "gain of energy over 2 s of tumbling", "relative", 1e-3, toss)
        .source("contact is passive")
        .why("Corners and edges strike while it turns: contact may take energy and never give it."),
    Row::new("stiff ground", "speed after a landing on k = 1e7 N/m", "of the impact's", 1.05, stiff)
        .source("contact is passive")
        .why("Hard ground is a stiff spring, and a step too long for it throws the body off."),
    Row::new("tip into ground", "gain of energy, pendulum at 7 rad/s", "relative", 0.01, |trial| tip(trial, 1.0))
        .source("contact is passive")
        .why("A fast link strikes at its tip: contact acts through the joints."),
    Row::new("heavy tip", "gain of energy, the same, tip mass x 1e4", "relative", 0.01, |trial| tip(trial, 1e4))
        .source("contact is passive")
        .why("The same with a load at the tip, against which the joints weigh nothing."),
    Row::new("light tip", "gain of energy, the same, tip mass x 1e-4", "relative", 0.01, |trial| tip(trial, 1e-4))
        .source("contact is passive")
        .why("The same with a tip of no weight, whose own acceleration knows no bounds."),
    Row::new("under terrain", "depth 1 s after a start 3 cm under hills", "m", 0.005, under)
        .source("a surface pushes out; m g / k is 1 mm")
        .why("Whatever starts inside the ground must come out of it."),
];

/// A sphere of radius 5 cm and 1 kg.
fn ball() -> Body {
    Body { shape: r#"<sphere radius="0.05"/>"#.into(), inertia: [1e-3; 3], ..Default::default() }
}

fn rest(trial: &Trial) -> Result<f64, Error> {
    let body = Body::default();
    let motion = trial.passive(&body.system()?, "ground", &Body::at([0.0, 0.0, 0.1]), 300)?;
    // A box's corners have a contact radius of 1e-5 m.
    let depth = if trial.method.rigid { 0.0 } else { body.mass * GRAVITY / (4.0 * body.material[0]) };
    Ok((vector(motion.last()) - Vector3::new(0.0, 0.0, 0.1 + 1e-5 - depth)).norm())
}

fn restitution(trial: &Trial) -> Result<f64, Error> {
    let mut worst = 0.0f64;
    for damping in [10.0, 40.0] {
        let body = Body { material: [1e4, damping, 1e3, 0.5], ..ball() };
        let motion = trial.passive(&body.system()?, "ground", &Body::at([0.0, 0.0, 1.05]), 90)?;
        let z: Vec<f64> = motion.states.iter().map(|s| s[2] - 0.05).collect();
        let landed = z.windows(2).position(|w| w[1] > w[0]).unwrap_or(z.len() - 1);
        let rebound = z[landed..].iter().fold(0.0f64, |a, b| a.max(*b));
        // Damped while approaching, undamped while separating.
        let zeta = damping / (2.0 * (body.mass * 1e4f64).sqrt());
        let e = (-zeta * zeta.acos() / (1.0 - zeta * zeta).sqrt()).exp();
        worst = worst.max((rebound - e * e).abs());
    }
    Ok(worst)
}

fn toss(trial: &Trial) -> Result<f64, Error> {
    let start = Body::state([0.0, 0.0, 0.5], [0.2, 0.1, 0.3, 0.927], [6.0, -3.0, 2.0], [1.0, 0.5, 0.0]);
    let motion = trial.passive(&Body::default().system()?, "ground", &start, 120)?;
    Ok(motion.above(gain(&motion)))
}

fn tip(trial: &Trial, times: f64) -> Result<f64, Error> {
    let mut system = (*trial.robot("pendulum")?).clone();
    let tip = &mut system.robot.links[1].inertia;
    (tip.mass, tip.inertia) = (times * tip.mass, times * tip.inertia);
    let motion = trial.passive(&Arc::new(system), "ground1", &[0.0, 0.0, -7.0, 0.0], 120)?;
    // The heavy tip of 250 t correctly penetrates this soft ground and loses 0.4 % of its energy. So does the mass that
    // drives the light tip. Only the nominal tip must stay above the ground.
    Ok(if times == 1.0 { motion.above(gain(&motion)) } else { gain(&motion) })
}

/// Largest gain of energy over the start, relative to the start's kinetic energy.
fn gain(motion: &Motion) -> f64 {
    let (e, first) = (motion.energies(), motion.totals()[0].kinetic);
    e.iter().map(|x| (x - e[0]) / first).fold(0.0, f64::max)
}

fn stiff(trial: &Trial) -> Result<f64, Error> {
    let body = Body { material: [1e7, 100.0, 1e3, 0.5], ..ball() };
    let motion = trial.passive(&body.system()?, "ground", &Body::at([0.0, 0.0, 0.55]), 60)?;
    let speeds = motion.states.iter().map(|s| (vector(&s[10..]) + vector(&s[7..]).cross(&vector(s))).norm());
    Ok(speeds.fold(0.0, f64::max) / (2.0 * GRAVITY * 0.5).sqrt())
}

fn under(trial: &Trial) -> Result<f64, Error> {
    let (system, x, y) = (ball().system()?, 1.0, 2.0);
    let start = Body::at([x, y, nerd_sim::scene::hill(x, y) - 0.03 + 0.05]);
    let motion = trial.passive(&system, "hills", &start, 60)?;
    let event = system.scene("hills")?.contact(&vector(motion.last()));
    Ok((0.05 - event.distance).max(0.0))
}

pub(super) static ROWS: [Row; 7] = [
    Row::new("stopping distance", "error, mu 0.2 0.4 0.7", "relative", 0.05, stopping)
        .source("Newton tests; v^2 / 2 mu g")
        .why("Dry friction is mu times the load at any speed."),
    Row::new("friction threshold", "slip below the angle, or 2 cm / slip above it", "2 cm", 1.0, threshold)
        .source("Newton tests; tan a = mu, mu 0.5, slopes 10 20 24, 29 35 40 deg, 0.5 s")
        .why("Dry friction holds below its angle and lets go above it; a viscous one always creeps."),
    Row::new("sliding down", "error of the way, 35 deg, mu 0.5, 1 s", "relative", 0.05, sliding)
        .source("g (sin a - mu cos a) t^2 / 2")
        .why("Above the angle a body accelerates by what friction leaves, neither held nor let go."),
    Row::new("plate at four yaws", "a plate: spread of way, lateral way, yaw", "relative", 0.02, |trial| {
        yaws(trial, plate(), 0.05)
    })
    .source("Coulomb's cone is round")
    .why("A turn about the vertical changes nothing, unless friction is reckoned along two fixed axes."),
    Row::new("cube at four yaws", "a cube: spread of way, lateral way, yaw", "relative", 0.02, |trial| {
        yaws(trial, Body::default(), 0.1)
    })
    .source("Coulomb's cone is round")
    .why("The same for a tall body, whose load moves from corner to corner."),
    Row::new(
        "table at four yaws",
        "a table of four round feet: spread of way, lateral way, yaw",
        "relative",
        0.02,
        |trial| yaws(trial, table(), 0.27),
    )
    .source("Coulomb's cone is round")
    .why("The same on four balls, each of them a single contact."),
    Row::new("rolling ball", "error of the speed, 15 deg, 1 s", "relative", 5e-3, rolling)
        .source("Drake's scene; 5/7 g sin a t")
        .why("Friction at one point must turn the ball as fast as it travels."),
];

/// A plate of 0.4 x 0.4 x 0.1 m and 1 kg.
fn plate() -> Body {
    let (a, b) = ((0.16 + 0.01) / 12.0, 0.32 / 12.0);
    Body { shape: r#"<box size="0.4 0.4 0.1"/>"#.into(), inertia: [a, a, b], ..Default::default() }
}

/// A table of 1 kg: its centre 0.27 m above the ground, on four feet 0.6 m by 0.4 m apart.
fn table() -> Body {
    Body { feet: Some([0.3, 0.2, 0.25]), inertia: [0.03, 0.05, 0.07], ..Default::default() }
}

fn stopping(trial: &Trial) -> Result<f64, Error> {
    let mut worst = 0.0f64;
    for mu in [0.2, 0.4, 0.7] {
        let body = Body { material: [1e4, 100.0, 1e3, mu], ..plate() };
        let motion = trial.passive(
            &body.system()?,
            "ground",
            &Body::state([0.0, 0.0, 0.05], UPRIGHT, [0.0; 3], [2.0, 0.0, 0.0]),
            90,
        )?;
        worst = worst.max((motion.last()[0] / (4.0 / (2.0 * mu * GRAVITY)) - 1.0).abs());
    }
    Ok(worst)
}

/// Distance (m) and velocity (m/s) down a slope after `frames` frames from rest.
fn down(trial: &Trial, body: Body, degrees: f64, height: f64, frames: usize) -> Result<(f64, f64), Error> {
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

fn threshold(trial: &Trial) -> Result<f64, Error> {
    let mut worst = 0.0f64;
    for degrees in [10.0, 20.0, 24.0, 29.0, 35.0, 40.0] {
        let slip = down(trial, plate(), degrees, 0.05, 30)?.0.abs() / 0.02;
        worst = worst.max(if degrees < 26.0 { slip } else { (1.0 / slip).min(1e3) });
    }
    Ok(worst)
}

fn sliding(trial: &Trial) -> Result<f64, Error> {
    let a = 35f64.to_radians();
    Ok((down(trial, plate(), 35.0, 0.05, 60)?.0 / (0.5 * GRAVITY * (a.sin() - 0.5 * a.cos())) - 1.0).abs())
}

fn rolling(trial: &Trial) -> Result<f64, Error> {
    let ball = Body { shape: r#"<sphere radius="0.1"/>"#.into(), inertia: [0.004; 3], ..Default::default() };
    Ok((down(trial, ball, 15.0, 0.1, 60)?.1 / (5.0 / 7.0 * GRAVITY * 15f64.to_radians().sin()) - 1.0).abs())
}

fn yaws(trial: &Trial, body: Body, height: f64) -> Result<f64, Error> {
    let system = Body { material: [1e4, 100.0, 1e3, 0.4], ..body }.system()?;
    let (mut ways, mut worst) = (Vec::new(), 0.0f64);
    for degrees in [0.0f64, 15.0, 30.0, 45.0] {
        let half = 0.5 * degrees.to_radians();
        let q = [0.0, 0.0, half.sin(), half.cos()];
        let motion =
            trial.passive(&system, "ground", &Body::state([0.0, 0.0, height], q, [0.0; 3], [2.0, 0.0, 0.0]), 60)?;
        let last = motion.last();
        let yaw = quaternion(&last[3..7]).angle_to(&quaternion(&q));
        worst = worst.max(last[1].abs() / last[0].abs().max(1e-3)).max(yaw);
        ways.push(last[0]);
    }
    let (low, high) = ways.iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
    // The body must have slid and stopped.
    let expected = 4.0 / (2.0 * 0.4 * GRAVITY);
    Ok(if (low / expected - 1.0).abs() > 0.5 { 1.0 } else { worst.max((high - low) / high) })
}
