//! What the error comes from: one thing is changed at a time, under two solvers, and two figures are taken: the error
//! against the measurement, and how far the prediction parted from the unchanged one.

use anyhow::Result;
use nalgebra::{Matrix3, Vector3};
use nerd_sim::sampling::{normal, stream};
use serde::Serialize;

use super::cube::{Cube, SOLID, lowest};
use super::data::{DT, Sample, Toss};
use super::method::pair;
use super::protocol::{METRIC, Motion, Score, Trial, against, lifted, roll, score, windows};

/// Noise of measured velocities, by axis.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Noise {
    /// m/s.
    pub velocity: f64,
    /// rad/s.
    pub spin: f64,
    /// Flights it was taken from.
    pub flights: usize,
}

/// One changed thing.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// What.
    pub change: String,
    /// Under each of the two solvers; none where the change is not one of that solver's.
    pub by_method: Vec<Option<Effect>>,
}

/// What a change does.
#[derive(Clone, Debug, Serialize)]
pub struct Effect {
    /// Distance from the measurement.
    pub error: Score,
    /// Distance from the unchanged prediction, if it is one of the same motions.
    pub parted: Option<Score>,
}

/// One thing that is not as in the first line.
struct Change {
    what: String,
    starts: Vec<Trial>,
    cube: Cube,
    /// Times the substeps.
    finer: usize,
    /// Whether friction follows the solver's other law.
    other: bool,
}

/// The line whose motions are not of the first line's scale.
const METRES: &str = "lengths metric (divided by 0.979)";

/// In flight the velocity is linear in time and the spin of a cube constant; what is left is noise.
pub fn noise(tosses: &[Toss]) -> Noise {
    let (mut v2, mut w2, mut v_free, mut w_free, mut flights) = (0.0, 0.0, 0.0, 0.0, 0);
    for toss in tosses {
        // The filter on the velocities looks one sample ahead.
        let flight = &toss.samples[..toss.first_contact.saturating_sub(2).min(toss.samples.len())];
        if flight.len() < 6 {
            continue;
        }
        let n = flight.len() as f64;
        let middle = 0.5 * (n - 1.0);
        let (mut v, mut slope, mut w, mut square) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros(), 0.0);
        for (k, s) in flight.iter().enumerate() {
            let t = k as f64 - middle;
            (v, slope, w, square) = (v + s.velocity / n, slope + s.velocity * t, w + s.spin / n, square + t * t);
        }
        slope /= square;
        for (k, s) in flight.iter().enumerate() {
            v2 += (s.velocity - v - slope * (k as f64 - middle)).norm_squared();
            w2 += (s.spin - w).norm_squared();
        }
        (v_free, w_free, flights) = (v_free + 3.0 * (n - 2.0), w_free + 3.0 * (n - 1.0), flights + 1);
    }
    Noise { velocity: f64::sqrt(v2 / v_free), spin: f64::sqrt(w2 / w_free), flights }
}

/// Puts noise on the velocities of every start; trial k draws from stream k of the seed.
pub fn disturbed(trials: &[Trial], noise: Noise, seed: u64) -> Vec<Trial> {
    let mut all = trials.to_vec();
    for (k, trial) in all.iter_mut().enumerate() {
        let mut rng = stream(seed, k as u64);
        // Normal numbers, by the column.
        let normal = Matrix3::from_fn(|_, _| normal(&mut rng));
        trial.start.velocity += normal.column(0) * noise.velocity;
        trial.start.spin += normal.column(1) * noise.spin;
    }
    all
}

/// A measured velocity is the mean of the frame before it; in flight, half a frame of gravity makes it that of its moment.
fn moments(trials: &[Trial]) -> Vec<Trial> {
    let mut all = trials.to_vec();
    for Trial { start: Sample { pose, velocity, .. }, .. } in &mut all {
        if lowest(pose) > 0.002 {
            velocity.z -= 0.5 * 9.81 * DT;
        }
    }
    all
}

/// The lines, the noise behind some of them, and the prediction of the second solver with noise against that without.
pub fn lines(tosses: &[Toss], every: usize, seed: u64) -> Result<(Vec<Line>, Noise, Score)> {
    let raw = windows(tosses, every, 1.0);
    let trials = lifted(&raw);
    let noise = noise(tosses);
    let little = Noise { velocity: 1e-3 * noise.velocity, spin: 1e-3 * noise.spin, ..noise };
    let cube = Cube::default();
    let kept = |flying: bool| trials.iter().filter(|t| t.flying == flying).cloned().collect::<Vec<_>>();
    let metric = lifted(&windows(tosses, every, METRIC));
    let change = |what: &str, cube: Cube| Change { what: what.into(), starts: trials.clone(), cube, finer: 1, other: false };
    let starts = |what: &str, starts: Vec<Trial>| Change { starts, ..change(what, cube) };
    let restitution = |x: f64| change(&format!("restitution {x}"), Cube { restitution: x, ..cube });
    let friction = |x: f64| change(&format!("friction {x}"), Cube { friction: x, ..cube });
    let damped =
        |what: &str, x: f64| change(&format!("{what} the friction damping"), Cube { friction_damping: x * cube.friction_damping, ..cube });
    let words = format!("noise on velocities, {:.1} mm/s and {:.3} rad/s", 1e3 * noise.velocity, noise.spin);
    let changes = [
        change("nothing", cube),
        starts("starts as measured, in the table too", raw),
        starts("only windows that begin in flight", kept(true)),
        starts("only windows that begin after the first touch", kept(false)),
        starts(&words, disturbed(&trials, noise, seed)),
        starts("a thousandth of that noise", disturbed(&trials, little, seed)),
        starts("velocities in flight half a frame older", moments(&trials)),
        starts(METRES, metric),
        restitution(0.06),
        restitution(0.25),
        restitution(0.5),
        friction(0.15),
        friction(0.17),
        friction(0.19),
        friction(0.21),
        Change { other: true, ..change("another friction law (simplified / Huber)", cube) },
        change("inertia of a solid cube", Cube { inertia: SOLID, ..cube }),
        Change { finer: 4, ..change("four times the substeps", cube) },
        change("ten times the stiffness", Cube { stiffness: 10.0 * cube.stiffness, ..cube }),
        damped("a fourth of", 0.25),
        damped("four times", 4.0),
    ];
    let bar = crate::common::bar("changes", changes.len() as u64);
    let (mut base, mut lines, mut floor): ([Vec<Motion>; 2], Vec<Line>, Score) = Default::default();
    for (k, Change { what, starts, cube, finer, other }) in changes.into_iter().enumerate() {
        // rapier's table does not give way.
        let rigid = Cube { stiffness: cube.stiffness, friction_damping: cube.friction_damping, ..Cube::default() };
        let compliance = cube == rigid && cube != Cube::default();
        let mut by_method = Vec::new();
        for (m, method) in pair(&cube, finer, other)?.iter().enumerate() {
            if compliance && m == 0 {
                by_method.push(None);
                continue;
            }
            let (motions, _) = roll(method, &starts)?;
            let error = against(&starts, &motions).brief();
            let same = k > 0 && motions.len() == base[m].len() && what != METRES;
            let parted = same.then(|| score(motions.iter().zip(&base[m])));
            if let Some(parted) = parted.as_ref().filter(|_| what == words && m == 1) {
                floor = parted.clone();
            }
            if k == 0 {
                base[m] = motions;
            }
            by_method.push(Some(Effect { error, parted: parted.map(Score::brief) }));
        }
        lines.push(Line { change: what, by_method });
        bar.set(k as u64 + 1);
    }
    // The last line: one solver's prediction against the other's.
    let parted = score(base[0].iter().zip(&base[1])).brief();
    let effects = lines[0].by_method.iter().flatten().map(|e| Some(Effect { error: e.error.clone(), parted: Some(parted.clone()) }));
    let line = Line { change: "the other solver".into(), by_method: effects.collect() };
    lines.push(line);
    bar.finish();
    Ok((lines, noise, floor))
}
