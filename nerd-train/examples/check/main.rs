//! Checks the GPU code against the CPU: networks, training, solvers, policies.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example check              all parts
//! cargo run --release -p nerd-train --features cuda --example check -- PART..    some of them
//! ```
//!
//! All checks run; if one fails, the program ends with an error.

mod gradients;
mod inference;
mod policies;
mod shac;
mod solvers;
mod training;
mod with;

use with::{Checks, Outcome};

/// Name and function of a part.
type Part = (&'static str, fn(&mut Checks) -> Outcome);

/// All parts, in order.
const PARTS: [Part; 13] = [
    ("operations", inference::operations),
    ("windows", inference::windows),
    ("streams", inference::streams),
    ("refusals", inference::refusals),
    ("gradients", training::gradients),
    ("updates", training::updates),
    ("chains", training::chains),
    ("solvers", solvers::solvers),
    ("predictions", solvers::predictions),
    ("vjp", gradients::gradients),
    ("shac", shac::shac),
    ("policies", policies::policies),
    ("tasks", policies::tasks),
];

fn main() -> Outcome {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let mut checks = Checks::default();
    for (name, part) in PARTS.iter().filter(|(name, _)| names.is_empty() || names.iter().any(|asked| asked == name)) {
        println!("{name}");
        if let Err(error) = part(&mut checks) {
            checks.demand(false, format!("{name}: {error}"));
        }
    }
    checks.end()
}
