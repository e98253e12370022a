//! Checks the CUDA engine on the GPU at hand and times it.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example cuda_check            checks, then times
//! cargo run --release -p nerd-train --features cuda --example cuda_check -- NAME..      some of them, by name
//! cargo run --release -p nerd-train --features cuda --example cuda_check -- dump DIR    raw f32 files of a short run
//! cargo run --release -p nerd-train --features cuda --example cuda_check -- step BATCH  one update for a profiler
//! ```
//!
//! Checks: every operation and every network against burn, outputs and gradients by weights and by tokens; every entry of the gradient of
//! larger networks against the CPU's, every tensor's against central differences along directions that do not depend on it, validation and
//! updates against the CPU's, bitwise resume, a falling loss, inference against a rolled window and the CPU's, the stream against the
//! CPU's, numbers that are none, and what must be refused. All are made; one that fails ends the program with an error.
//! `dump` writes what a comparison with another framework needs.

mod dump;
mod inference;
mod operations;
mod timing;
mod training;
mod with;

use std::error::Error;
use std::path::Path;

use nerd_train::learner::cuda::Precision;

type Outcome = Result<(), Box<dyn Error>>;

/// One by its name.
type Check = (&'static str, fn() -> Outcome);

/// In order.
const CHECKS: [Check; 11] = [
    ("operations", operations::operations),
    ("gradient", training::gradient),
    ("validation", training::validation),
    ("refusals", inference::refusals),
    ("updates", training::updates),
    ("resume", training::resume),
    ("learning", training::learning),
    ("windows", inference::windows),
    ("inference", inference::inference),
    ("streaming", inference::streaming),
    ("timing", timing::timing),
];

fn main() -> Outcome {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["dump", dir] => dump::dump(Path::new(dir)),
        ["step", batch] => with::learner(batch.parse()?, Precision::Tf32, 1.0)?.update_eagerly(1e-4).map_err(Into::into),
        ref names => {
            let mut failed = Vec::new();
            for (name, check) in CHECKS.iter().filter(|(name, _)| names.is_empty() || names.contains(name)) {
                if let Err(e) = check() {
                    println!("FAILED, {name}: {e}");
                    failed.push(*name);
                }
            }
            if failed.is_empty() { Ok(()) } else { Err(format!("failed: {}", failed.join(", ")).into()) }
        }
    }
}
