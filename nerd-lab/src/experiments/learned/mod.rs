//! The stability map of learned models: each against its truth, from starts inside and outside its training range, beside two predictors
//! without dynamics and another engine.
//!
//! Errors are relative to hold-last: 1 is a predictor that knows nothing.

use nerd_model::neural::Neural;
use nerd_sim::instruments::{Glide, Hold};
use nerd_sim::suite::{Cell, only};

use super::stability::StabilityMap;
use crate::prelude::*;
use asks::{ASKS, Ask, Case, Maker};

mod asks;

pub struct Learned {
    case: Case,
    asks: Vec<&'static Ask>,
}

impl Learned {
    /// The model of a folder, asked the questions with one of `words` in their names, or all.
    pub fn new(folder: &Path, words: &[String]) -> Result<Self> {
        let config = ModelConfig::read(folder)?;
        let system = System::named(&config.robot)?;
        let scene = system.scene(system.usual_scenes().last().copied().unwrap_or("free"))?;
        let case = Case { system, scene, model: folder.into(), truth: Truth::named(&config.truth).map_err(anyhow::Error::msg)? };
        Ok(Self { case, asks: only(ASKS.iter().collect(), words)? })
    }

    pub fn title(&self) -> String {
        let Case { scene, model, truth, .. } = &self.case;
        format!("{} in {}, learned from {}", model.display(), scene.name, truth.name())
    }
}

impl Experiment for Learned {
    fn about(&self) -> Result<About> {
        let Case { system, scene, model, truth } = &self.case;
        let folder = model.file_name().map_or_else(|| "model".into(), |n| n.to_string_lossy());
        let motion = |setting| Input::motion(&system.name, &scene.name, setting);
        // rapier need not know the robot.
        let motions = [motion(&Setting::from(*truth))?].into_iter().chain(motion(&Setting::RapierSteps(4)));
        let inputs = Inputs([Input::robot(system), Input::model(model)?].into_iter().chain(motions).collect());
        Ok(About { name: format!("stability-{folder}"), seed: 0, effort: self.asks.len() as f64, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let case = &self.case;
        let makers: [(&str, &Maker); 4] = [
            ("learned", &|system| Ok(Box::new(Neural::on_cpu(Model::load(&case.model, system, None)?)))),
            ("hold last", &|_| Ok(Box::new(Hold))),
            ("constant velocity", &|_| Ok(Box::new(Glide))),
            ("rapier 4x4", &|_| Ok(Box::new(Rapier::new(RapierConfig::default())))),
        ];
        let bar = bar(&format!("{}: cells", case.system.name), (self.asks.len() * makers.len()) as u64);
        let mut rows = Vec::new();
        for ask in &self.asks {
            let mut cells = Vec::new();
            for (_, maker) in &makers {
                cells.push(Cell::new((ask.measure)(case, *maker), None, ask.limit));
                bar.set((rows.len() * makers.len() + cells.len()) as u64);
            }
            rows.push(ask.line(cells));
        }
        bar.finish();
        StabilityMap { methods: makers.map(|m| m.0.to_string()).into(), rows }.measured()
    }
}
