//! A cable's kernels: [`super::Cable`] in 64 bits, on the kernels of a chain's frames, a block a rollout.

use std::fmt::Write;
use std::sync::Arc;

use nerd_model::chain::{INPUTS, chain_functions, numbers};
use nerd_sim::articulated::device::{Reach, record};
use nerd_sim::articulated::{ArticulatedConfig, Friction};
use nerd_sim::scene::Scene;
use nerd_sim::system::System;

use super::super::kernels::{OnCard, Widths};
use super::{ASTRAY, Cable, View};

impl OnCard for Cable {
    fn widths(&self) -> Widths {
        let rods = self.chain.rods;
        let threads = Some(rods.next_multiple_of(32).min(128));
        Widths { state: numbers(&self.chain), kept: 4 * rods, inputs: rods * INPUTS, torques: 6, threads }
    }

    fn program(&self, system: &Arc<System>, _: usize, colliders: usize) -> String {
        let mut text = chain_functions(&self.chain, &self.scale, system, colliders);
        let loss = &self.loss;
        for (name, x) in [("SHARE", loss.share), ("BY_RATE", loss.rate), ("BY_SPEED", loss.velocity), ("ASTRAY", ASTRAY)] {
            let _ = writeln!(text, "#define {name} {x:e}");
        }
        let led: Vec<String> = loss.gripper.iter().map(|x| format!("{x:e}")).collect();
        let _ = writeln!(text, "TABLE double BY_LED[] = {{{}}};", led.join(", "));
        text + include_str!("../shared.cuh") + include_str!("chain.cuh") + include_str!("chain_frame.cuh")
    }

    fn record(&self, system: &System, scene: &Scene, colliders: usize) -> Result<Vec<f64>, String> {
        record(scene, system, &ArticulatedConfig::implicit(1, Friction::Coulomb), Reach { colliders, ..Reach::default() })
    }

    fn numbers(view: &View) -> [f64; 4] {
        [view.mirror, view.sin, view.cos, view.yaw]
    }
}
