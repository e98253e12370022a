//! Solvers on a graphics card beside the CPU's: errors and frames a second of the articulated solver and of models, whose batch
//! never leaves the card.

#[cfg(feature = "cuda")]
mod pace;

use crate::{choice::Choice, prelude::*};

settings! {
    /// Solvers on a graphics card.
    pub struct Benchmark {
        /// Name of the result
        name: String = "benchmark".into(), Text;
        /// Robots with their scenes, ROBOT:SCENE, comma-separated
        robots: Vec<String> = ["pendulum:ground1", "cube:ground", "ant:ground", "anymal:ground", "franka:free"].map(String::from).into(), Texts;
        /// Rollouts whose error is measured
        rollouts: usize = 256, Whole(STARTS);
        /// Environments of the timed batch
        environments: usize = 8192, Whole(STARTS);
        /// Substeps of the implicit step, comma-separated
        substeps: Vec<usize> = vec![1, 2, 4, 8, 16, 32], Wholes(SUBSTEPS);
        /// Substeps of the explicit step, of Runge-Kutta where nothing touches, comma-separated
        explicit: Vec<usize> = vec![16, 64, 256], Wholes(SUBSTEPS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}

impl Benchmark {
    fn pairs(&self) -> Result<Vec<(&str, &str)>> {
        let wrong = |text: &str| anyhow::anyhow!("robots {text}: write ROBOT:SCENE, for example ant:ground");
        self.robots.iter().map(|text| text.split_once(':').ok_or_else(|| wrong(text))).collect()
    }

    /// The settings of a robot in a scene: steps, and the model that comes with the project.
    fn settings(&self, robot: &str, contact: bool) -> Vec<Setting> {
        let one = if contact { Setting::Euler } else { Setting::Rk4 };
        let steps = self.substeps.iter().copied().map(Setting::Implicit).chain(self.explicit.iter().copied().map(one));
        let model = shipped::models().join(robot);
        steps.chain(model.join("config.json").exists().then_some(Setting::Neural(model))).collect()
    }
}

impl Experiment for Benchmark {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        for (robot, scene) in self.pairs()? {
            inputs.add(Input::robot(&*System::named(robot)?));
            for setting in self.settings(robot, true).into_iter().filter(|s| matches!(s, Setting::Neural(_))).chain([Setting::Accurate]) {
                inputs.solver(&Choice::Setting(setting), robot, scene)?;
            }
        }
        let effort = (self.robots.len() * (self.rollouts + self.environments)) as f64;
        Ok(About { name: self.name.clone(), seed: self.seed, effort, inputs })
    }

    #[cfg(not(feature = "cuda"))]
    fn measure(&self) -> Result<Measured> {
        bail!("benchmark needs a build with `--features cuda`: cargo run --release -p xtask --features cuda -- measure benchmark")
    }

    #[cfg(feature = "cuda")]
    fn measure(&self) -> Result<Measured> {
        let mut paces = Vec::new();
        let bar = nerd_train::progress::bar("robots", self.robots.len() as u64);
        for (k, (robot, scene)) in self.pairs()?.into_iter().enumerate() {
            bar.set(k as u64);
            let course = pace::Course::new(robot, scene, self)?;
            let mut own = course.ours(&self.settings(robot, course.touching()))?;
            pace::mark(&mut own);
            paces.extend(own);
        }
        bar.finish();
        let table = pace::table(&paces, self);
        let mut measured = Measured::new(&serde_json::json!({ "paces": &paces }), vec![table])?;
        for (robot, scene) in self.pairs()? {
            measured = measured.with(format!("{robot}-{scene}"), pace::figure(&paces, &format!("{robot}, {scene}"), self.environments));
        }
        Ok(measured)
    }
}
