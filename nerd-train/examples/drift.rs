//! How far does a learned solver drift from its truth? `cargo run --release -p nerd-train --example drift`.

use nerd_model::{folder::Model, neural::Neural};
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named("pendulum")?;
    let scene = system.scene("ground1")?;
    let model = Model::load(std::path::Path::new("models/pendulum"), &system, Some("articulated accurate"))?;
    let mut learned = Neural::on_cpu(model, &system);
    let mut truth = Articulated::new(ArticulatedConfig::accurate(&system));
    let config = PassiveConfig { starts: 64, steps: 100, seed: 500, action: Action::Zero };
    let report = passive(&system, &scene, &mut truth, &mut learned, config, &mut |_step| ())?;
    println!("{:?} rad, hold-last {:?}, {} diverged", report.error, report.hold, report.diverged);
    Ok(())
}
