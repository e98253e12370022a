//! Speed against accuracy: every solver of a scene on one chart.
//!
//! x: microseconds of a frame of one environment on one core. y: mean |dq| (rad or m) from a converged reference over
//! the horizon. Motion is passive, from the robot's reset distribution. Time and error come from the same steps, so a
//! broken simulation cannot be fast. Dashed lines show the reference's own error (its distance from half its substeps)
//! and the error of repeating the start. A model of another engine is compared with that engine, since it cannot come
//! nearer to our reference. MuJoCo takes part if `--mujoco` names a Python that has it (`guest`). With `--device cuda`
//! time is per frame among many environments on a GPU (`experiments/card.rs`).
//!
//! `plan.rs` lists the solvers, `measure.rs` measures those with a [`SolverSpec`], and `guest.rs` measures another
//! engine.

mod guest;
mod measure;
mod plan;
mod shown;

use crate::prelude::*;
use nerd_train::cost::on_one_core;
use plan::Plan;

pub use plan::Chart;

impl Experiment for Chart {
    fn about(&self) -> Result<About> {
        let plan = self.plan()?;
        let Plan { system, scene, methods, .. } = &plan;
        let guests = self
            .mujoco
            .as_ref()
            .map_or(0, |_| guest::settings(plan.contact(), plan.environments.is_some(), self.max_substeps).len());
        // Adds one setting of each solver as an input: a change of the solver shows in any of its settings.
        let mut inputs = Inputs(vec![Input::robot(system)]);
        for (k, method) in methods.iter().enumerate() {
            let next = methods.get(k + 1).is_some_and(|next| next.series == method.series);
            if method.spec.asked().is_none_or(|n| n == 4 || (n < 4 && !next)) {
                // Leaves out a solver that gives up: it has no final state to be identified by.
                let _ = inputs.solver(&method.spec, &self.robot, &scene.name);
            }
            if let Some(own) = method.own {
                inputs.add(Input::motion(&self.robot, &scene.name, &own.into())?);
            }
        }
        let effort = ((methods.len() + guests) * self.trajectories * self.frames) as f64;
        let there = if plan.environments.is_some() { "-cuda" } else { "" };
        Ok(About { name: format!("chart-{}-{}{there}", system.name, scene.name), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let plan = self.plan()?;
        plan.refused.iter().for_each(|line| tell!("{line}"));
        // Starts MuJoCo first, so that a missing one is reported before measuring.
        let mut referee = self.mujoco.as_ref().map(|python| guest::referee(python, &plan)).transpose()?;
        let all = || measure::all(&plan, self.max_substeps);
        let (mut data, reference) = if plan.environments.is_some() { all()? } else { on_one_core(all)? };
        if let Some(referee) = &mut referee {
            // Keeps our own points if MuJoCo fails.
            match guest::points(referee, &plan, self.max_substeps, &reference, &data.reference) {
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
