//! What the error comes from: one thing is changed at a time, under two solvers, and two figures are taken: the error
//! against the measurement, and how far the prediction parted from the unchanged one.

use nerd_sim::measured::*;
use serde::{Deserialize, Serialize};

use super::methods::pair;
use crate::error::Result;
use crate::progress::bar;

/// One changed thing.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Line {
    /// What.
    pub change: String,
    /// Under each of the two solvers; none where the change is not one of that solver's, or there are no such starts.
    pub by_method: Vec<Option<Effect>>,
}

/// What a change does.
#[derive(Clone, Debug, Serialize, Deserialize)]
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
/// What the line of the noise begins with.
const NOISE: &str = "noise on velocities";

/// All changes, the first of them none.
fn changes(tosses: &[Toss], every: usize, noise: Noise, seed: u64) -> Vec<Change> {
    let raw = windows(tosses, every, 1.0);
    let trials = lifted(&raw);
    let cube = Cube::default();
    let kept = |flying: bool| trials.iter().filter(|t| t.flying == flying).cloned().collect::<Vec<_>>();
    let metric = lifted(&windows(tosses, every, METRIC));
    let change = |what: &str, cube: Cube| Change { what: what.into(), starts: trials.clone(), cube, finer: 1, other: false };
    let starts = |what: &str, starts: Vec<Trial>| Change { starts, ..change(what, cube) };
    let restitution = |x: f64| change(&format!("restitution {x}"), Cube { restitution: x, ..cube });
    let friction = |x: f64| change(&format!("friction {x}"), Cube { friction: x, ..cube });
    let damped =
        |what: &str, x: f64| change(&format!("{what} the friction damping"), Cube { friction_damping: x * cube.friction_damping, ..cube });
    let words = format!("{NOISE}, {:.1} mm/s and {:.3} rad/s", 1e3 * noise.velocity, noise.spin);
    vec![
        change("nothing", cube),
        starts("starts as measured, in the table too", raw),
        starts("only windows that begin in flight", kept(true)),
        starts("only windows that begin after the first touch", kept(false)),
        starts(&words, disturbed(&trials, noise, seed)),
        starts("a thousandth of that noise", disturbed(&trials, noise.times(1e-3), seed)),
        starts("velocities in flight half a frame older", aged(&trials)),
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
    ]
}

/// The lines, the noise behind some of them, and the prediction of the second solver with noise against that without.
pub fn lines(tosses: &[Toss], every: usize, seed: u64) -> Result<(Vec<Line>, Noise, Score)> {
    let noise = noise(tosses);
    let changes = changes(tosses, every, noise, seed);
    let bar = bar("changes", changes.len() as u64);
    let (mut base, mut lines, mut floor): ([Vec<Motion>; 2], Vec<Line>, Score) = Default::default();
    for (k, Change { what, starts, cube, finer, other }) in changes.into_iter().enumerate() {
        // rapier's table does not give way.
        let rigid = Cube { stiffness: cube.stiffness, friction_damping: cube.friction_damping, ..Cube::default() };
        let compliance = cube == rigid && cube != Cube::default();
        let mut by_method = Vec::new();
        for (m, method) in pair(&cube, finer, other)?.iter().enumerate() {
            if starts.is_empty() || compliance && m == 0 {
                by_method.push(None);
                continue;
            }
            let (motions, _) = method.roll(&starts)?;
            let error = against(&starts, &motions).brief();
            let same = k > 0 && motions.len() == base[m].len() && what != METRES;
            let parted = same.then(|| score(motions.iter().zip(&base[m])));
            if let Some(parted) = parted.as_ref().filter(|_| what.starts_with(NOISE) && m == 1) {
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
