//! Rows without contact or joints: laws of a free rigid body.

use super::*;

pub(super) static ROWS: [Row; 8] = [
    Row::new("free fall", "distance from the parabola, 1 s", "m", GRAVITY / 960.0, free_fall)
        .source("p0 + v0 t - g t^2/2; g t dt of Newton's tests, dt = 1/960 s")
        .why("The simplest motion there is: a step of first order misses the parabola by g t dt / 2."),
    Row::new("off-centre spin", "travel of the COM, 2 s without gravity", "m", 1e-3, off_centre)
        .source("momentum is constant")
        .why("A body turns about its centre of mass, not about the origin that its state is written at."),
    Row::new("precession", "change of angular momentum, 2 s", "relative", 5e-3, precession)
        .source("Newton tests: I (0.2 0.5 0.4), w (0.7 -0.5 0.9)")
        .why("Without torque angular momentum stays, in size and direction, while the angular velocity wanders."),
    Row::new("tumbling box", "change of angular momentum, 10 s", "relative", 0.02, tumbling)
        .source("rapier tests: half extents 1 2 3, principal axes tilted 0.7 rad")
        .why("The same with principal axes tilted against the body's own, where a wrongly turned inertia shows."),
    Row::new("gyroscopic energy", "change of energy, 10 s about the middle axis", "relative", 0.01, gyroscopic)
        .source("MuJoCo tests: box 0.1 0.2 0.3 m, E < 1.01 E0")
        .why("The gyroscopic term of an explicit step feeds energy into a spinning body."),
    Row::new("Dzhanibekov", "error of the body's angular velocity, 5 s", "relative", 0.05, dzhanibekov)
        .source("Euler's equations, integrated apart at 1e-4 s")
        .why("Spin about the middle axis flips, and when it flips magnifies every error of the step."),
    Row::new("Dzhanibekov, f32", "angular velocity, 5 s in f32 of 1 ms against f64", "relative", 0.05, single)
        .source("rounding of 6e-8 a frame, grown by exp(w t sqrt((B-A)(C-B)/AC))")
        .why("Networks and GPUs compute in f32: this is what it costs where errors grow fastest."),
    Row::new("far away", "flight 100 km from the origin against flight at it, 1 s", "m", 1e-6, far_away)
        .source("the world has no centre")
        .why("Robots travel: numbers must not become coarser on the way."),
];

fn free_fall(trial: &Trial) -> Result<f64, Error> {
    let system = Body::default().system()?;
    let motion = trial.passive(&system, "free", &Body::state([0.0; 3], UPRIGHT, [0.0; 3], [1.0, 0.0, 3.0]), 60)?;
    let gap = |(k, s): (usize, &Vec<f64>)| {
        let t = k as f64 / 60.0;
        (vector(s) - Vector3::new(t, 0.0, 3.0 * t - 0.5 * GRAVITY * t * t)).norm()
    };
    Ok(motion.states.iter().enumerate().map(gap).fold(0.0, f64::max))
}

fn off_centre(trial: &Trial) -> Result<f64, Error> {
    let com = [0.1, 0.0, 0.02];
    let system = Body { com, gravity: 0.0, inertia: [0.01, 0.02, 0.03], ..Default::default() }.system()?;
    let w = [0.3, 2.0, 5.0];
    let v = -Vector3::from(w).cross(&Vector3::from(com));
    let motion = trial.passive(&system, "free", &Body::state([0.0; 3], UPRIGHT, w, v.into()), 120)?;
    let totals = motion.totals();
    let travel = totals.iter().map(|t| (t.com - totals[0].com).norm()).fold(0.0, f64::max);
    Ok(if turned(&motion) { travel } else { 1.0 })
}

fn precession(trial: &Trial) -> Result<f64, Error> {
    let body = Body { inertia: [0.2, 0.5, 0.4], gravity: 0.0, frame: "1/100", ..Default::default() };
    spin(trial, &body, [0.7, -0.5, 0.9], 200)
}

fn tumbling(trial: &Trial) -> Result<f64, Error> {
    // A solid box of 8 kg: m (b^2 + c^2) / 3 in half extents; its principal axes are tilted about (1, 1, 1).
    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
    let (roll, pitch, yaw) = nalgebra::UnitQuaternion::from_axis_angle(&axis, 0.7).euler_angles();
    let inertia = [13.0, 10.0, 5.0].map(|x| 8.0 / 3.0 * x);
    spin(
        trial,
        &Body { mass: 8.0, inertia, rpy: [roll, pitch, yaw], gravity: 0.0, ..Default::default() },
        [3.0, 7.0, 2.0],
        600,
    )
}

/// Largest relative change of angular momentum; 1 if the body did not rotate.
fn spin(trial: &Trial, body: &Body, w: [f64; 3], frames: usize) -> Result<f64, Error> {
    let motion = trial.passive(&body.system()?, "free", &Body::state([0.0; 3], UPRIGHT, w, [0.0; 3]), frames)?;
    let l: Vec<_> = motion.totals().iter().map(|t| t.momentum.ang).collect();
    let change = l.iter().map(|x| (x - l[0]).norm() / l[0].norm()).fold(0.0, f64::max);
    Ok(if turned(&motion) { change } else { 1.0 })
}

/// A box of 0.1, 0.2 and 0.3 m and 1 kg.
fn brick() -> Body {
    Body { inertia: [0.13 / 12.0, 0.1 / 12.0, 0.05 / 12.0], gravity: 0.0, frame: "1/200", ..Default::default() }
}

fn gyroscopic(trial: &Trial) -> Result<f64, Error> {
    let motion = trial.passive(
        &brick().system()?,
        "free",
        &Body::state([0.0; 3], UPRIGHT, [0.05, 5.0, 0.05], [0.0; 3]),
        2000,
    )?;
    let e = motion.energies();
    let change = e.iter().map(|x| (x / e[0] - 1.0).abs()).fold(0.0, f64::max);
    Ok(if turned(&motion) { change } else { 1.0 })
}

fn dzhanibekov(trial: &Trial) -> Result<f64, Error> {
    let (start, frames) = (Vector3::new(0.05, 5.0, 0.05), 1000);
    let motion =
        trial.passive(&brick().system()?, "free", &Body::state([0.0; 3], UPRIGHT, start.into(), [0.0; 3]), frames)?;
    let last = motion.last();
    let found = quaternion(&last[3..7]).inverse() * vector(&last[7..10]);
    // Reference: I w' = -w x I w by classical Runge-Kutta.
    let inertia = Vector3::from(brick().inertia);
    let rate = |w: Vector3<f64>| -w.cross(&inertia.component_mul(&w)).component_div(&inertia);
    let (mut w, h) = (start, 1e-4);
    for _ in 0..frames * 50 {
        let a = rate(w);
        let b = rate(w + a * (0.5 * h));
        let c = rate(w + b * (0.5 * h));
        let d = rate(w + c * h);
        w += (a + (b + c) * 2.0 + d) * (h / 6.0);
    }
    Ok((found - w).norm() / start.norm())
}

fn far_away(trial: &Trial) -> Result<f64, Error> {
    let system = Body { com: [0.1, 0.0, 0.0], ..Default::default() }.system()?;
    let fly = |at: [f64; 3]| {
        let motion = trial.passive(&system, "free", &Body::state(at, UPRIGHT, [1.0, 2.0, 3.0], [1.0, 0.0, 3.0]), 60)?;
        Ok::<_, Error>(vector(motion.last()) - Vector3::from(at))
    };
    Ok((fly([1e5, -1e5, 1e5])? - fly([0.0; 3])?).norm())
}

/// Whether the orientation ever changed by more than 0.1 rad.
fn turned(motion: &Motion) -> bool {
    let first = quaternion(&motion.states[0][3..7]);
    motion.states.iter().any(|s| quaternion(&s[3..7]).angle_to(&first) > 0.1)
}

fn single(trial: &Trial) -> Result<f64, Error> {
    let body = Body { frame: "1/1000", ..brick() };
    let start = Body::state([0.0; 3], UPRIGHT, [0.05, 5.0, 0.05], [0.0; 3]);
    let double = trial.passive(&body.system()?, "free", &start, 5000)?;
    let rounded = trial.method.clone().around(|solver| Box::new(Rounded(solver)));
    let single = Trial::new(&rounded).passive(&body.system()?, "free", &start, 5000)?;
    let [a, b] = [&double, &single].map(|m| vector(&m.last()[7..]));
    Ok(if turned(&double) { (a - b).norm() / a.norm() } else { 1.0 })
}

/// A solver with its states rounded to f32 after every frame.
struct Rounded(Box<dyn Solver>);

impl Solver for Rounded {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.0.step(batch, torques)?;
        batch.states.iter_mut().for_each(|x| *x = f64::from(*x as f32));
        Ok(())
    }
}
