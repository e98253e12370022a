//! The computation around a chain's network as GPU code: the text of two kernels, `chain_tell` and `chain_apply`.
//!
//! The kernels compute in f64. They use the vectors and surfaces of the articulated solver's kernels.

use nerd_sim::articulated::device::{number, surfaces};

use super::features::{INPUTS, QUICK, REACH};
use super::{layout::Chain, step::OUTPUTS};
use crate::prelude::*;
use crate::program::op::padded;

/// Number of doubles that store a chain on a GPU: 12 of the gripper, then the rods' directions and their rates. The
/// buffer between the two kernels holds this many per environment.
pub fn numbers(chain: &Chain) -> usize {
    12 + 6 * chain.rods
}

/// The kernels for a chain in scenes of at most `colliders` colliders; `scale` is the scale of each output.
pub fn chain_program(chain: &Chain, scale: &[f64; OUTPUTS], system: &System, colliders: usize) -> String {
    chain_functions(chain, scale, system, colliders) + include_str!("chain_frame.cuh")
}

/// As `chain_program`, but only the functions that the kernels call, without the kernels.
pub fn chain_functions(chain: &Chain, scale: &[f64; OUTPUTS], system: &System, colliders: usize) -> String {
    let mut text = surfaces(colliders);
    text.define([("RODS", chain.rods), ("INPUTS", INPUTS), ("LDX", padded(INPUTS)), ("OUTPUTS", OUTPUTS)]);
    let lengths = [
        ("LENGTH", chain.length),
        ("RADIUS", chain.radius),
        ("FRAME", chain.frame_time),
        ("REACH", REACH),
        ("QUICK", QUICK),
    ];
    text.define(lengths.map(|(name, x)| (name, number(x))));
    text.table("double", "HOME", chain.home.iter().copied());
    text.table("double", "STIFFNESS", chain.stiffness);
    text.table("double", "PULSE", chain.pulse);
    text.table("double", "STRETCH", *scale);
    text.table("int", "WRAPS", system.robot.joints().map(|joint| f64::from(joint.wraps())));
    text.0 + include_str!("chain.cuh")
}
