//! Stiffness and dampers of the compliant table, chosen on the tosses of even number and scored on those of odd number.
//! Friction stays as published.

use serde::{Deserialize, Serialize};

use super::MeasuredError;
use super::cube::Cube;
use super::protocol::{Make, Trial, roll};
use super::score::{Score, against};

/// What was chosen, and what it is worth.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Fit {
    /// Settings tried.
    pub tried: usize,
    /// The best on the even half.
    pub cube: Cube,
    /// Its damper (N s/m).
    pub damping: f64,
    /// Of the best, on the even half.
    pub even: Score,
    /// Of the best, on the odd half.
    pub odd: Score,
}

const STIFFNESSES: [f64; 4] = [3e3, 1e4, 3e4, 1e5];
const RESTITUTIONS: [f64; 4] = [0.06, 0.125, 0.25, 0.5];
const FRICTION_DAMPINGS: [f64; 3] = [50.0, 200.0, 800.0];

/// Those of tosses of odd number, or of even.
pub fn half(trials: &[Trial], odd: bool) -> Vec<Trial> {
    trials.iter().filter(|t| (t.toss % 2 == 1) == odd).cloned().collect()
}

/// The table that suits the solver that `make` makes best on half of `trials`, which are lifted; `progress` is told settings
/// done, and of how many.
///
/// # Errors
/// As [`roll`].
pub fn fit(make: &Make<'_>, trials: &[Trial], progress: &mut dyn FnMut(usize, usize)) -> Result<Fit, MeasuredError> {
    let (even, odd) = (half(trials, false), half(trials, true));
    let of = |cube: &Cube, trials: &[Trial]| -> Result<Score, MeasuredError> {
        Ok(against(trials, &roll(&cube.system()?, make, trials)?.0).brief())
    };
    let base = of(&Cube::default(), &even)?;
    // Half of the half: the choice is a coarse one.
    let some: Vec<Trial> = even.iter().step_by(2).cloned().collect();
    let mut settings = Vec::new();
    for stiffness in STIFFNESSES {
        for restitution in RESTITUTIONS {
            settings.extend(FRICTION_DAMPINGS.map(|friction_damping| Cube { stiffness, restitution, friction_damping, ..Cube::default() }));
        }
    }
    let tried = settings.len();
    let mut best = (f64::MAX, Cube::default());
    for (k, cube) in settings.into_iter().enumerate() {
        let found = of(&cube, &some)?;
        let worth = found.position / base.position + found.rotation / base.rotation;
        if worth < best.0 {
            best = (worth, cube);
        }
        progress(k + 1, tried);
    }
    let cube = best.1;
    Ok(Fit { tried, cube, damping: cube.damping(), even: of(&cube, &even)?, odd: of(&cube, &odd)? })
}
