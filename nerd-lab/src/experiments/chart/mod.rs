//! Speed against accuracy: every solver of a scene on one picture.
//!
//! x: microseconds that a frame of one environment takes on one core. y: mean |difference| of q over the horizon from a converged
//! reference, passive motion from the robot's reset law. Time and error come from the same steps, so a broken simulation cannot
//! be fast. The reference's own error (its distance from half its substeps) is a dashed line, as is the floor that repeats the
//! start. A model that learned from another engine is compared with that engine, as its name says, since it cannot be nearer to
//! the reference than what it learned. MuJoCo takes part where a Python has it (`guest`). With `--device cuda` time is per frame among
//! many environments on a GPU (`card`).

mod guest;
mod measure;
mod plan;
mod shown;

use crate::{choice::Choice, prelude::*};
use nerd_train::cost::on_one_core;
use plan::Plan;

pub use plan::Chart;

impl Experiment for Chart {
    fn about(&self) -> Result<About> {
        let plan = self.plan()?;
        let Plan { system, scene, methods, .. } = &plan;
        let guests = self.mujoco.as_ref().map_or(0, |_| guest::settings(plan.contact(), plan.environments.is_some(), self.substeps).len());
        // Of each solver one setting: whatever changes the others changes it.
        let mut inputs = Inputs(vec![Input::robot(system)]);
        for (k, method) in methods.iter().enumerate() {
            let next = methods.get(k + 1).is_some_and(|next| next.series == method.series);
            if method.setting.substeps().is_none_or(|n| n == 4 || (n < 4 && !next)) {
                // One that gives up on the way has no end to be known by.
                let _ = inputs.solver(&Choice::Setting(method.setting.clone()), &self.robot, &scene.name);
            }
            if let Some(own) = method.own {
                inputs.add(Input::motion(&self.robot, &scene.name, &own.into())?);
            }
        }
        let effort = ((methods.len() + guests) * self.starts * self.frames) as f64;
        let there = if plan.environments.is_some() { "-cuda" } else { "" };
        Ok(About { name: format!("chart-{}-{}{there}", system.name, scene.name), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let plan = self.plan()?;
        plan.refused.iter().for_each(|line| tell!("{line}"));
        // Begun first, for it may not be there.
        let mut referee = self.mujoco.as_ref().map(|python| guest::referee(python, &plan)).transpose()?;
        let all = || measure::all(&plan, self.substeps);
        let (mut data, reference) = if plan.environments.is_some() { all()? } else { on_one_core(all)? };
        if let Some(referee) = &mut referee {
            // What is measured of our own is kept, whatever becomes of it.
            match guest::points(referee, &plan, self.substeps, &reference, &data.reference) {
                Ok((points, against)) => {
                    data.points.extend(points);
                    data.mujoco = Some(against);
                }
                Err(reason) => tell!("MuJoCo: left out, {reason:#}"),
            }
        }
        data.mark();
        Ok(Measured::new(&data, vec![data.table(&plan.system)])?.with("figure", data.figure()))
    }
}
