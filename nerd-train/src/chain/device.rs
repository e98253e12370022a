//! Rollouts and the gradient of their loss on a device: the kernels around the network, forward and backward.
//!
//! They are [`super::Unroll`], [`super::View`] and [`super::Loss`] in 64 bits, on the kernels of a chain's frames.

use std::fmt::Write;

use nerd_model::chain::{Chain, OUTPUTS, chain_functions};
use nerd_sim::system::System;

use super::course::ASTRAY;
use super::loss::Loss;
use super::view::View;

/// Numbers of a rollout, as the host sends it: motion, first frame of the update, whether it restarts, view.
pub const ROLLOUT: usize = 7;

/// A rollout's numbers.
pub fn row(motion: usize, frame: usize, anew: bool, view: &View) -> [f64; ROLLOUT] {
    let View { mirror, sin, cos, yaw } = *view;
    [motion as f64, frame as f64, f64::from(u8::from(anew)), mirror, sin, cos, yaw]
}

/// The text for a chain, for scenes of at most so many colliders; `scale` is the scale of each output.
pub fn unroll_program(chain: &Chain, scale: &[f64; OUTPUTS], loss: &Loss, system: &System, colliders: usize) -> String {
    let mut text = chain_functions(chain, scale, system, colliders);
    for (name, x) in [("SHARE", loss.share), ("BY_RATE", loss.rate), ("BY_SPEED", loss.velocity), ("ASTRAY", ASTRAY)] {
        let _ = writeln!(text, "#define {name} {x:e}");
    }
    let led: Vec<String> = loss.gripper.iter().map(|x| format!("{x:e}")).collect();
    let _ = writeln!(text, "TABLE double BY_LED[] = {{{}}};", led.join(", "));
    text + include_str!("unroll.cuh") + include_str!("unroll_frame.cuh")
}
