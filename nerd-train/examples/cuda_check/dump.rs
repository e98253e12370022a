//! What a comparison with another framework needs.

use std::path::Path;

use nerd_model::transformer::TransformerConfig;
use nerd_train::learner::cuda::{CudaForward, CudaLearner, Precision};
use nerd_train::learner::{Learner, LearnerState};
use nerd_train::windows::draw;

use crate::Outcome;
use crate::with::{configuration, weights, windows};

/// Weights, drawn windows, gradients, and the state after five updates, as raw little-endian f32.
pub fn dump(dir: &Path) -> Outcome {
    let config = TransformerConfig::paper(37, 4, 192);
    let save = |name: &str, x: &[f32]| std::fs::write(dir.join(name), x.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    let (train, validation) = (windows(2, config, 200, 100), windows(3, config, 20, 100));
    let start = weights(config, 0.05);
    save("weights", &start.flat)?;
    for step in 0..5 {
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for row in 0..512 {
            let t = train.first_token(draw(5, step, row, train.len() as u64) as usize);
            x.extend(&train.x[t * 37..(t + 10) * 37]);
            y.extend(&train.y[t * 4..(t + 10) * 4]);
        }
        save(&format!("x{step}"), &x)?;
        save(&format!("y{step}"), &y)?;
    }
    for precision in [Precision::F32, Precision::Tf32] {
        let mut learner = CudaLearner::new(configuration(512), precision, LearnerState::new(start.clone()), &train, &validation)?;
        let (loss, g) = learner.gradient()?;
        save(&format!("gradient_{precision:?}"), &g)?;
        (0..5).try_for_each(|_| learner.update(1e-3))?;
        let p = learner.progress()?;
        let state = learner.state()?;
        save(&format!("trained_{precision:?}"), &state.weights.flat)?;
        save(&format!("average_{precision:?}"), &state.average)?;
        save(&format!("scalars_{precision:?}"), &[loss, p.loss, p.gradient_norm, learner.validate(700)?])?;
        let inputs = windows(9, config, 33, 8).x;
        save("forward_x", &inputs)?;
        save("forward_y", &CudaForward::new(&start, Precision::F32, 40)?.forward(&inputs, 8, &[5; 33])?)?;
    }
    save("validation_x", &validation.x)?;
    save("validation_y", &validation.y)?;
    Ok(())
}
