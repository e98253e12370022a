//! Rows that compare a solver with itself: with finer steps, and restarted.

use crate::sampling::{Start, start, stream};
use crate::suite::row::Row;
use crate::suite::trial::{Error, Motion, Trial};

pub(super) static ROWS: [Row; 3] = [
    Row::new("pendulum self-convergence", "against four times the substeps, ground, 1 s, 4 starts", "rad", 1.2e-3, |trial| {
        against_finer(trial, "pendulum", "ground1")
    })
    .source("a tenth of the paper's error of a learned pendulum, 0.012 rad")
    .why("A truth to learn from must be nearer to its own limit than models come to the truth."),
    Row::new("Ant self-convergence", "against four times the substeps, dropped, 1 s, 4 starts", "rad", 4.7e-3, |trial| {
        against_finer(trial, "ant", "ground")
    })
    .source("a tenth of the paper's error of a learned Ant, 0.047 rad")
    .why("The same for a walking robot that lands on its feet."),
    Row::new("Markov", "a motion against its second half begun afresh, or after a reset", "rad", 1e-12, markov)
        .source("the next state is a function of the present one")
        .why("A model learns a function of the state: of a solver that remembers more there is none."),
];

/// Mean |dq| at the end of a second between a method and itself with four times the substeps; 1 if from some start no
/// coordinate moved by 0.3 rad or m, a fall's least being 0.5.
fn against_finer(trial: &Trial, robot: &str, scene: &str) -> Result<f64, Error> {
    let system = trial.robot(robot)?;
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

fn markov(trial: &Trial) -> Result<f64, Error> {
    let system = trial.robot("pendulum")?;
    let whole = trial.passive(&system, "ground1", &[1.0, 0.5, 0.0, 0.0], 80)?;
    let fresh = trial.passive(&system, "ground1", &whole.states[40], 40)?;
    let reset = trial.after_reset(&system, "ground1", &[-1.0, 1.0, 3.0, -2.0], &whole.states[40], 40)?;
    let gap = |half: &Motion| whole.last().iter().zip(half.last()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    Ok(gap(&fresh).max(gap(&reset)))
}
