//! A robot's kernels: [`super::Robot`] in 64 bits, on the kernels of a model's frames, a thread a rollout.

use std::fmt::Write;
use std::sync::Arc;

use nerd_model::around::Around;
use nerd_model::device::{settings, slope_functions};
use nerd_model::features::Features;
use nerd_sim::articulated::device::{Reach, record};
use nerd_sim::scene::Scene;
use nerd_sim::system::System;

use super::super::kernels::{OnCard, Widths};
use super::{Robot, SHARE};

impl OnCard for Robot {
    fn widths(&self) -> Widths {
        let Around { system, form, .. } = &self.around;
        let (robot, inputs) = (&system.robot, Features::inputs(system, *form));
        Widths { state: robot.state_dim(), kept: 0, inputs, torques: robot.joint_count(), threads: None }
    }

    fn program(&self, system: &Arc<System>, rollouts: usize, colliders: usize) -> String {
        let mut text = slope_functions(self.around.form, &self.around.normalizer, system, colliders);
        let _ = writeln!(text, "#define SHARE {SHARE:e}\n#define ROLLOUTS {rollouts}");
        for (name, numbers) in [("UNIT", &self.units), ("COUNTS", &self.weights)] {
            let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:e}")).collect();
            let _ = writeln!(text, "TABLE double {name}[] = {{{}}};", numbers.join(", "));
        }
        text + include_str!("../shared.cuh") + include_str!("robot.cuh") + include_str!("robot_frame.cuh")
    }

    fn record(&self, system: &System, scene: &Scene, colliders: usize) -> Result<Vec<f64>, String> {
        record(scene, system, &settings(), Reach { colliders, ..Reach::default() })
    }

    fn numbers((): &()) -> [f64; 4] {
        [0.0; 4]
    }
}
