//! Every operation and every network on the card against its meaning in burn: outputs, gradients by weights and by tokens.

use nerd_model::program::specimens::{Specimen, TOKENS, WINDOWS, networks, operations as each};
use nerd_train::learner::cuda::{CudaProgram, Precision};

use crate::Outcome;

/// Largest error, as a share of the largest entry.
const ROUNDING: f32 = 2e-5;

pub fn operations() -> Outcome {
    let mut wrong = Vec::new();
    for specimen in each().into_iter().chain(networks()) {
        match errors(&specimen) {
            Ok(errors) => {
                println!(
                    "{}: output {:.1e}, gradients by weights {:.1e}, by tokens {:.1e} from burn",
                    specimen.name, errors[0], errors[1], errors[2]
                );
                if errors.iter().any(|e| e.is_nan() || *e > ROUNDING) {
                    wrong.push(specimen.name);
                }
            }
            Err(e) => {
                println!("{}: {e}", specimen.name);
                wrong.push(specimen.name);
            }
        }
    }
    if wrong.is_empty() { Ok(()) } else { Err(format!("not burn's: {}", wrong.join(", ")).into()) }
}

/// Twice, since a pass uses the memory of the one before.
fn errors(specimen: &Specimen) -> Result<[f32; 3], Box<dyn std::error::Error>> {
    let Specimen { program, flat, tokens, behind, .. } = specimen;
    let (expected, mut cuda) = (specimen.by_burn(), CudaProgram::new(program.clone(), flat, Precision::F32, WINDOWS, TOKENS)?);
    let mut errors = [0.0f32; 3];
    for _ in 0..2 {
        let said = cuda.forward(tokens)?;
        let (by_weights, by_tokens) = cuda.backward(behind)?;
        for ((found, expected), worst) in [said, by_weights, by_tokens].iter().zip(&expected).zip(&mut errors) {
            let largest = expected.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
            let off = crate::with::largest(found, expected) / largest;
            *worst = if off.is_nan() || off > *worst { off } else { *worst };
        }
    }
    Ok(errors)
}
