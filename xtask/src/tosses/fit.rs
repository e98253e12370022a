//! Stiffness and dampers of the compliant table, chosen on the tosses of even number and scored on those of odd number.
//! Friction stays as published.

use anyhow::Result;
use serde::Serialize;

use super::cube::Cube;
use super::method::{Method, pair};
use super::protocol::{Score, Trial, against, roll};

/// What was chosen, and what it is worth.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    /// Settings tried.
    pub tried: usize,
    /// The best on the even half.
    pub cube: Cube,
    /// Its damper (N s/m).
    pub damping: f64,
    /// Of the best, on the even and on the odd half.
    pub even: Score,
    pub odd: Score,
    /// Of the settings of the first table, on the odd half: rapier from starts as measured, rapier, articulated.
    pub odd_before: [Score; 3],
}

const STIFFNESSES: [f64; 4] = [3e3, 1e4, 3e4, 1e5];
const RESTITUTIONS: [f64; 4] = [0.06, 0.125, 0.25, 0.5];
const FRICTION_DAMPINGS: [f64; 3] = [50.0, 200.0, 800.0];

/// Fits on half of `trials`, which are lifted; `raw` are the same ones as measured.
pub fn fit(raw: &[Trial], trials: &[Trial]) -> Result<Fit> {
    let half = |trials: &[Trial], odd: u64| trials.iter().filter(|t| t.toss % 2 == odd).cloned().collect::<Vec<_>>();
    let (even, odd) = (half(trials, 0), half(trials, 1));
    let [first, ours] = pair(&Cube::default(), 1, false)?;
    let of = |method: &Method, trials: &[Trial]| -> Result<Score> { Ok(against(trials, &roll(method, trials)?.0).brief()) };
    let base = of(&ours, &even)?;
    // Half of the half: the choice is a coarse one.
    let some: Vec<Trial> = even.iter().step_by(2).cloned().collect();
    let tried = STIFFNESSES.len() * RESTITUTIONS.len() * FRICTION_DAMPINGS.len();
    let bar = crate::common::bar("settings", tried as u64);
    let mut best = (f64::MAX, Cube::default());
    let mut done = 0;
    for stiffness in STIFFNESSES {
        for restitution in RESTITUTIONS {
            for friction_damping in FRICTION_DAMPINGS {
                let cube = Cube { stiffness, restitution, friction_damping, ..Cube::default() };
                let found = of(&Method::new("fitted", &cube, ours.setting)?, &some)?;
                let worth = found.position / base.position + found.rotation / base.rotation;
                if worth < best.0 {
                    best = (worth, cube);
                }
                done += 1;
                bar.set(done);
            }
        }
    }
    bar.finish();
    let chosen = Method::new("fitted", &best.1, ours.setting)?;
    Ok(Fit {
        tried,
        cube: best.1,
        damping: best.1.damping(),
        even: of(&chosen, &even)?,
        odd: of(&chosen, &odd)?,
        odd_before: [of(&first, &half(raw, 1))?, of(&first, &odd)?, of(&ours, &odd)?],
    })
}
