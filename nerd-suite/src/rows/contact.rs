//! Rows of contact (rest, rebounds, impacts) and of friction (a body that slides or rolls).

use super::*;

pub(super) const LANDING: &[Row] = &[
    row(
        "rest",
        "distance from where it must lie after 5 s",
        "m",
        1e-3,
        "m g / 4 k below the surface",
        "A body left alone lies still, as deep as its springs say: it does not creep, sink or tremble.",
        rest,
    ),
    row(
        "restitution",
        "error of rebound / drop height, two dampings",
        "",
        0.05,
        "spring and damper's closed form e^2; 0.05 of rapier's tests",
        "The damper decides how high a ball bounces; a step that looks too far ahead swallows the bounce.",
        restitution,
    ),
];

pub(super) const PASSIVE: &[Row] = &[
    row(
        "tossed cube",
        "gain of energy over 2 s of tumbling",
        "relative",
        1e-3,
        "contact is passive",
        "Corners and edges strike while it turns: contact may take energy and never give it.",
        toss,
    ),
    row(
        "stiff ground",
        "speed after a landing on k = 1e7 N/m",
        "of the impact's",
        1.05,
        "contact is passive",
        "Hard ground is a stiff spring, and a step too long for it throws the body off.",
        stiff,
    ),
    row(
        "tip into ground",
        "gain of energy, pendulum at 7 rad/s",
        "relative",
        0.01,
        "contact is passive",
        "A fast link strikes at its tip: contact acts through the joints.",
        |trial| tip(trial, 1.0),
    ),
    row(
        "heavy tip",
        "gain of energy, the same, tip mass x 1e4",
        "relative",
        0.01,
        "contact is passive",
        "The same with a load at the tip, against which the joints weigh nothing.",
        |trial| tip(trial, 1e4),
    ),
    row(
        "light tip",
        "gain of energy, the same, tip mass x 1e-4",
        "relative",
        0.01,
        "contact is passive",
        "The same with a tip of no weight, whose own acceleration knows no bounds.",
        |trial| tip(trial, 1e-4),
    ),
    row(
        "under terrain",
        "depth 1 s after a start 3 cm under hills",
        "m",
        0.005,
        "a surface pushes out; m g / k is 1 mm",
        "Whatever starts inside the ground must come out of it.",
        under,
    ),
];

/// A sphere of 1 kg with a radius of 5 cm.
fn ball() -> Body {
    Body { shape: r#"<sphere radius="0.05"/>"#.into(), inertia: [1e-3; 3], ..Default::default() }
}

fn rest(trial: &Trial) -> Result<f64> {
    let body = Body::default();
    let motion = trial.passive(&body.system()?, "ground", &Body::at([0.0, 0.0, 0.1]), 300)?;
    // Adds 1e-5 m, the contact radius of a box's corners.
    Ok((vector(motion.last()) - Vector3::z() * (0.1 + 1e-5 - sunk(trial, &body, 4.0))).norm())
}

fn restitution(trial: &Trial) -> Result<f64> {
    worst([10.0, 40.0], |damping: f64| {
        let body = Body { material: [1e4, damping, 1e3, 0.5], ..ball() };
        let motion = trial.passive(&body.system()?, "ground", &Body::at([0.0, 0.0, 1.05]), 90)?;
        let z: Vec<f64> = motion.states.iter().map(|s| s[2] - 0.05).collect();
        let landed = z.windows(2).position(|w| w[1] > w[0]).unwrap_or(z.len() - 1);
        let rebound = most(z[landed..].iter().copied());
        // Restitution of a contact that is damped while approaching, and undamped while separating.
        let zeta = damping / (2.0 * (body.mass * 1e4f64).sqrt());
        let e = (-zeta * zeta.acos() / (1.0 - zeta * zeta).sqrt()).exp();
        Ok((rebound - e * e).abs())
    })
}

fn toss(trial: &Trial) -> Result<f64> {
    let start = Body::state([0.0, 0.0, 0.5], [0.2, 0.1, 0.3, 0.927], [6.0, -3.0, 2.0], [1.0, 0.5, 0.0]);
    let motion = trial.passive(&Body::default().system()?, "ground", &start, 120)?;
    Ok(motion.above(gain(&motion)))
}

fn tip(trial: &Trial, times: f64) -> Result<f64> {
    let mut system = (*trial.robot("pendulum")?).clone();
    let tip = &mut system.robot.links[1].inertia;
    (tip.mass, tip.inertia) = (times * tip.mass, times * tip.inertia);
    let motion = trial.passive(&Arc::new(system), "ground1", &[0.0, 0.0, -7.0, 0.0], 120)?;
    // The heavy tip of 250 t correctly penetrates this soft ground and loses 0.4 % of its energy. So does the mass that
    // drives the light tip. Only the nominal tip must stay above the ground.
    Ok(if times == 1.0 { motion.above(gain(&motion)) } else { gain(&motion) })
}

/// Largest gain of energy over the start's energy, divided by the start's kinetic energy.
fn gain(motion: &Motion) -> f64 {
    let e = motion.energies();
    let first = motion.totals()[0].kinetic;
    most(e.iter().map(|x| (x - e[0]) / first))
}

fn stiff(trial: &Trial) -> Result<f64> {
    let body = Body { material: [1e7, 100.0, 1e3, 0.5], ..ball() };
    let motion = trial.passive(&body.system()?, "ground", &Body::at([0.0, 0.0, 0.55]), 60)?;
    Ok(most(motion.states.iter().map(|s| velocity(s).norm())) / (2.0 * GRAVITY * 0.5).sqrt())
}

fn under(trial: &Trial) -> Result<f64> {
    let system = ball().system()?;
    let x = 1.0;
    let y = 2.0;
    let start = Body::at([x, y, nerd_sim::scene::hill(x, y) - 0.03 + 0.05]);
    let motion = trial.passive(&system, "hills", &start, 60)?;
    let event = system.scene("hills")?.contact(&vector(motion.last()));
    Ok((0.05 - event.distance).max(0.0))
}

pub(super) const ROWS: &[Row] = &[
    row(
        "stopping distance",
        "error, mu 0.2 0.4 0.7",
        "relative",
        0.05,
        "Newton tests; v^2 / 2 mu g",
        "Dry friction is mu times the load at any speed.",
        stopping,
    ),
    row(
        "friction threshold",
        "slip below the angle, or 2 cm / slip above it",
        "2 cm",
        1.0,
        "Newton tests; tan a = mu, mu 0.5, slopes 10 20 24, 29 35 40 deg, 0.5 s",
        "Dry friction holds below its angle and lets go above it; a viscous one always creeps.",
        threshold,
    ),
    row(
        "sliding down",
        "error of the way, 35 deg, mu 0.5, 1 s",
        "relative",
        0.05,
        "g (sin a - mu cos a) t^2 / 2",
        "Above the angle a body accelerates by what friction leaves, neither held nor let go.",
        sliding,
    ),
    row(
        "plate at four yaws",
        "a plate: spread of way, lateral way, yaw",
        "relative",
        0.02,
        "Coulomb's cone is round",
        "A turn about the vertical changes nothing, unless friction is reckoned along two fixed axes.",
        |trial| yaws(trial, plate(), 0.05),
    ),
    row(
        "cube at four yaws",
        "a cube: spread of way, lateral way, yaw",
        "relative",
        0.02,
        "Coulomb's cone is round",
        "The same for a tall body, whose load moves from corner to corner.",
        |trial| yaws(trial, Body::default(), 0.1),
    ),
    row(
        "table at four yaws",
        "a table of four round feet: spread of way, lateral way, yaw",
        "relative",
        0.02,
        "Coulomb's cone is round",
        "The same on four balls, each of them a single contact.",
        |trial| yaws(trial, table(), 0.27),
    ),
    row(
        "rolling ball",
        "error of the speed, 15 deg, 1 s",
        "relative",
        5e-3,
        "Drake's scene; 5/7 g sin a t",
        "Friction at one point must turn the ball as fast as it travels.",
        rolling,
    ),
];

/// A plate of 1 kg and 0.4 x 0.4 x 0.1 m.
fn plate() -> Body {
    let a = (0.16 + 0.01) / 12.0;
    let b = 0.32 / 12.0;
    Body { shape: r#"<box size="0.4 0.4 0.1"/>"#.into(), inertia: [a, a, b], ..Default::default() }
}

/// A table of 1 kg on four feet 0.6 m by 0.4 m apart. Its centre is 0.27 m above the ground.
fn table() -> Body {
    Body { feet: Some([0.3, 0.2, 0.25]), inertia: [0.03, 0.05, 0.07], ..Default::default() }
}

fn stopping(trial: &Trial) -> Result<f64> {
    let start = Body::state([0.0, 0.0, 0.05], UPRIGHT, [0.0; 3], [2.0, 0.0, 0.0]);
    worst([0.2, 0.4, 0.7], |mu| {
        let body = Body { material: [1e4, 100.0, 1e3, mu], ..plate() };
        let motion = trial.passive(&body.system()?, "ground", &start, 90)?;
        Ok((motion.last()[0] / (4.0 / (2.0 * mu * GRAVITY)) - 1.0).abs())
    })
}

/// Releases a body at rest on a slope, and returns its distance (m) and velocity (m/s) downhill after `frames` frames.
fn down(trial: &Trial, body: Body, degrees: f64, height: f64, frames: usize) -> Result<(f64, f64)> {
    let slope = degrees.to_radians();
    let body = Body { slope, ..body };
    let (s, c) = slope.sin_cos();
    let q = [0.0, (0.5 * slope).sin(), 0.0, (0.5 * slope).cos()];
    let start = Body::state([s * height, 0.0, c * height], q, [0.0; 3], [0.0; 3]);
    let motion = trial.passive(&body.system()?, "ground", &start, frames)?;
    let along = Vector3::new(c, 0.0, -s);
    let last = motion.last();
    Ok((along.dot(&(vector(last) - vector(&start))), along.dot(&velocity(last))))
}

fn threshold(trial: &Trial) -> Result<f64> {
    worst([10.0, 20.0, 24.0, 29.0, 35.0, 40.0], |degrees| {
        let slip = down(trial, plate(), degrees, 0.05, 30)?.0.abs() / 0.02;
        Ok(if degrees < 26.0 { slip } else { (1.0 / slip).min(1e3) })
    })
}

fn sliding(trial: &Trial) -> Result<f64> {
    let a = 35f64.to_radians();
    Ok((down(trial, plate(), 35.0, 0.05, 60)?.0 / (0.5 * GRAVITY * (a.sin() - 0.5 * a.cos())) - 1.0).abs())
}

fn rolling(trial: &Trial) -> Result<f64> {
    let ball = Body { shape: r#"<sphere radius="0.1"/>"#.into(), inertia: [0.004; 3], ..Default::default() };
    Ok((down(trial, ball, 15.0, 0.1, 60)?.1 / (5.0 / 7.0 * GRAVITY * 15f64.to_radians().sin()) - 1.0).abs())
}

fn yaws(trial: &Trial, body: Body, height: f64) -> Result<f64> {
    let system = Body { material: [1e4, 100.0, 1e3, 0.4], ..body }.system()?;
    let mut ways = Vec::new();
    let mut worst = 0.0f64;
    for degrees in [0.0f64, 15.0, 30.0, 45.0] {
        let half = 0.5 * degrees.to_radians();
        let q = [0.0, 0.0, half.sin(), half.cos()];
        let start = Body::state([0.0, 0.0, height], q, [0.0; 3], [2.0, 0.0, 0.0]);
        let motion = trial.passive(&system, "ground", &start, 60)?;
        let last = motion.last();
        let yaw = quaternion(&last[3..7]).angle_to(&quaternion(&q));
        worst = worst.max(last[1].abs() / last[0].abs().max(1e-3)).max(yaw);
        ways.push(last[0]);
    }
    let (low, high) = ways.iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
    // Fails if the body did not slide about as far as it must.
    let expected = 4.0 / (2.0 * 0.4 * GRAVITY);
    Ok(if (low / expected - 1.0).abs() > 0.5 { 1.0 } else { worst.max((high - low) / high) })
}
