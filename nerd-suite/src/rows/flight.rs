//! Rows without contact or joints: laws of a free rigid body.

use super::*;

pub(super) const ROWS: &[Row] = &[
    row(
        "free fall",
        "distance from the parabola, 1 s",
        "m",
        GRAVITY / 960.0,
        "p0 + v0 t - g t^2/2; g t dt of Newton's tests, dt = 1/960 s",
        "The simplest motion there is: a step of first order misses the parabola by g t dt / 2.",
        free_fall,
    ),
    row(
        "off-centre spin",
        "travel of the COM, 2 s without gravity",
        "m",
        1e-3,
        "momentum is constant",
        "A body turns about its centre of mass, not about the origin that its state is written at.",
        off_centre,
    ),
    row(
        "precession",
        "change of angular momentum, 2 s",
        "relative",
        5e-3,
        "Newton tests: I (0.2 0.5 0.4), w (0.7 -0.5 0.9)",
        "Without torque angular momentum stays, in size and direction, while the angular velocity wanders.",
        precession,
    ),
    row(
        "tumbling box",
        "change of angular momentum, 10 s",
        "relative",
        0.02,
        "rapier tests: half extents 1 2 3, principal axes tilted 0.7 rad",
        "The same with principal axes tilted against the body's own, where a wrongly turned inertia shows.",
        tumbling,
    ),
    row(
        "gyroscopic energy",
        "change of energy, 10 s about the middle axis",
        "relative",
        0.01,
        "MuJoCo tests: box 0.1 0.2 0.3 m, E < 1.01 E0",
        "The gyroscopic term of an explicit step feeds energy into a spinning body.",
        gyroscopic,
    ),
    row(
        "Dzhanibekov",
        "error of the body's angular velocity, 5 s",
        "relative",
        0.05,
        "Euler's equations, integrated apart at 1e-4 s",
        "Spin about the middle axis flips, and when it flips magnifies every error of the step.",
        dzhanibekov,
    ),
    row(
        "Dzhanibekov, f32",
        "angular velocity, 5 s in f32 of 1 ms against f64",
        "relative",
        0.05,
        "rounding of 6e-8 a frame, grown by exp(w t sqrt((B-A)(C-B)/AC))",
        "Networks and GPUs compute in f32: this is what it costs where errors grow fastest.",
        single,
    ),
    row(
        "far away",
        "flight 100 km from the origin against flight at it, 1 s",
        "m",
        1e-6,
        "the world has no centre",
        "Robots travel: numbers must not become coarser on the way.",
        far_away,
    ),
];

/// Rolls out a body without contact from the origin, with angular velocity `w` (rad/s) and velocity `v` (m/s).
fn fly(trial: &Trial, body: &Body, w: [f64; 3], v: [f64; 3], frames: usize) -> Result<Motion> {
    trial.passive(&body.system()?, "free", &Body::state([0.0; 3], UPRIGHT, w, v), frames)
}

/// Returns `figure` if the body turned by more than 0.1 rad, else 1 (a failure).
fn turned(motion: &Motion, figure: f64) -> f64 {
    let first = quaternion(&motion.states[0][3..7]);
    let turns = motion.states.iter().any(|s| quaternion(&s[3..7]).angle_to(&first) > 0.1);
    if turns { figure } else { 1.0 }
}

fn free_fall(trial: &Trial) -> Result<f64> {
    let motion = fly(trial, &Body::default(), [0.0; 3], [1.0, 0.0, 3.0], 60)?;
    let gap = |(k, s): (usize, &Vec<f64>)| {
        let t = k as f64 / 60.0;
        (vector(s) - Vector3::new(t, 0.0, 3.0 * t - 0.5 * GRAVITY * t * t)).norm()
    };
    Ok(most(motion.states.iter().enumerate().map(gap)))
}

fn off_centre(trial: &Trial) -> Result<f64> {
    let com = [0.1, 0.0, 0.02];
    let body = Body { com, gravity: 0.0, inertia: [0.01, 0.02, 0.03], ..Default::default() };
    let w = [0.3, 2.0, 5.0];
    let v = -Vector3::from(w).cross(&Vector3::from(com));
    let motion = fly(trial, &body, w, v.into(), 120)?;
    let totals = motion.totals();
    Ok(turned(&motion, most(totals.iter().map(|t| (t.com - totals[0].com).norm()))))
}

fn precession(trial: &Trial) -> Result<f64> {
    let body = Body { inertia: [0.2, 0.5, 0.4], gravity: 0.0, frame: "1/100", ..Default::default() };
    spin(trial, &body, [0.7, -0.5, 0.9], 200)
}

fn tumbling(trial: &Trial) -> Result<f64> {
    // A solid box of 8 kg, with moments m (b^2 + c^2) / 3 for half extents b, c. Its principal axes are tilted about
    // (1, 1, 1).
    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
    let (roll, pitch, yaw) = nalgebra::UnitQuaternion::from_axis_angle(&axis, 0.7).euler_angles();
    let inertia = [13.0, 10.0, 5.0].map(|x| 8.0 / 3.0 * x);
    let body = Body { mass: 8.0, inertia, rpy: [roll, pitch, yaw], gravity: 0.0, ..Default::default() };
    spin(trial, &body, [3.0, 7.0, 2.0], 600)
}

/// Largest change of a free body's angular momentum, divided by its start value; `w` is in rad/s.
fn spin(trial: &Trial, body: &Body, w: [f64; 3], frames: usize) -> Result<f64> {
    let motion = fly(trial, body, w, [0.0; 3], frames)?;
    let l: Vec<_> = motion.totals().iter().map(|t| t.momentum.ang).collect();
    Ok(turned(&motion, most(l.iter().map(|x| (x - l[0]).norm() / l[0].norm()))))
}

/// A box of 0.1 x 0.2 x 0.3 m and 1 kg.
fn brick() -> Body {
    Body { inertia: [0.13 / 12.0, 0.1 / 12.0, 0.05 / 12.0], gravity: 0.0, frame: "1/200", ..Default::default() }
}

/// Start angular velocity (rad/s) of the brick: about its middle principal axis, slightly disturbed.
const MIDDLE: [f64; 3] = [0.05, 5.0, 0.05];

fn gyroscopic(trial: &Trial) -> Result<f64> {
    let motion = fly(trial, &brick(), MIDDLE, [0.0; 3], 2000)?;
    let e = motion.energies();
    Ok(turned(&motion, most(e.iter().map(|x| (x / e[0] - 1.0).abs()))))
}

fn dzhanibekov(trial: &Trial) -> Result<f64> {
    let frames = 1000;
    let motion = fly(trial, &brick(), MIDDLE, [0.0; 3], frames)?;
    let last = motion.last();
    let found = quaternion(&last[3..7]).inverse() * vector(&last[7..10]);
    // Integrates the reference, I w' = -w x I w in body axes, by classical Runge-Kutta.
    let inertia = Vector3::from(brick().inertia);
    let rate = |w: Vector3<f64>| -w.cross(&inertia.component_mul(&w)).component_div(&inertia);
    let mut w = Vector3::from(MIDDLE);
    let h = 1e-4;
    for _ in 0..frames * 50 {
        let a = rate(w);
        let b = rate(w + a * (0.5 * h));
        let c = rate(w + b * (0.5 * h));
        let d = rate(w + c * h);
        w += (a + (b + c) * 2.0 + d) * (h / 6.0);
    }
    Ok((found - w).norm() / Vector3::from(MIDDLE).norm())
}

fn far_away(trial: &Trial) -> Result<f64> {
    let system = Body { com: [0.1, 0.0, 0.0], ..Default::default() }.system()?;
    let fly = |at: [f64; 3]| -> Result<_> {
        let motion = trial.passive(&system, "free", &Body::state(at, UPRIGHT, [1.0, 2.0, 3.0], [1.0, 0.0, 3.0]), 60)?;
        Ok(vector(motion.last()) - Vector3::from(at))
    };
    Ok((fly([1e5, -1e5, 1e5])? - fly([0.0; 3])?).norm())
}

fn single(trial: &Trial) -> Result<f64> {
    let body = Body { frame: "1/1000", ..brick() };
    let double = fly(trial, &body, MIDDLE, [0.0; 3], 5000)?;
    let rounded = trial.method.clone().around(|solver| Box::new(Rounded(solver)));
    let single = fly(&Trial::new(&rounded), &body, MIDDLE, [0.0; 3], 5000)?;
    let [a, b] = [&double, &single].map(|m| vector(&m.last()[7..]));
    Ok(turned(&double, (a - b).norm() / a.norm()))
}

/// A solver whose states are rounded to f32 after every frame.
struct Rounded(Box<dyn Solver>);

impl Solver for Rounded {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.0.step(batch, torques)?;
        batch.states.iter_mut().for_each(|x| *x = f64::from(*x as f32));
        Ok(())
    }
}
