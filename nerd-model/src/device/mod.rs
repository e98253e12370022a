//! The computation around the network as GPU code: the text of two kernels, `neural_tell` and `neural_apply`. A small
//! network itself becomes one kernel, `whole_pass`. [`crate::chain`] has the kernels around a chain's network.
//!
//! The kernels build on those of the articulated solver ([`nerd_sim::articulated::device`]). All of them also compile
//! as plain C++, so tests need no GPU.

mod residual;
mod whole;

use nerd_sim::articulated::device::{Reach, Real, functions, number};

use crate::features::{Features, NEAR, waves};
use crate::form::{Form, View};
use crate::prelude::*;
use crate::{base::Base, normalizer::Normalizer, program::Program};

pub use crate::program::op::padded;
pub use residual::held_in_f16;
pub use whole::{Products, Whole};

/// Number of threads that write one environment's token.
pub const LANES: usize = 4;

/// One kernel that evaluates a network over windows of `tokens` tokens, `[tokens][padded inputs]`. The network is a
/// chain's, or with f16 products a residual network (`program/networks.rs`). `None` for other networks, or if the
/// network does not fit into the kernel.
pub fn whole_program(program: &Program, tokens: usize, products: Products) -> Option<Whole> {
    if products == Products::F16 {
        residual::residual(program).filter(|_| tokens == 1)
    } else {
        whole::chain(program, tokens)
    }
}

/// The kernels for models of `system` with this form and normaliser, for scenes within `reach`.
pub fn program(form: Form, normalizer: &Normalizer, system: &Arc<System>, real: Real, reach: Reach) -> String {
    token_functions(form, normalizer, system, real, reach) + include_str!("tokens_frame.cuh")
}

/// A frame and its adjoint in f64: kernels `gradients_look`, `gradients_said` and `gradients_back`. The network runs
/// between them.
pub fn gradient_program(form: Form, normalizer: &Normalizer, system: &Arc<System>, reach: Reach) -> String {
    let functions = token_functions(form, normalizer, system, Real::F64, reach);
    functions + include_str!("tokens_back.cuh") + include_str!("gradients_frame.cuh")
}

/// As `program`, but only the functions `tell` and `apply`, for use in other kernels.
fn token_functions(
    form: Form,
    normalizer: &Normalizer,
    system: &Arc<System>,
    real: Real,
    Reach { colliders, fields, hulls, paired, .. }: Reach,
) -> String {
    let robot = &system.robot;
    let mut text = functions(
        system,
        &ArticulatedConfig::implicit(1, Friction::Coulomb),
        real,
        Reach { colliders, fields, hulls, paired, ..Reach::default() },
        false,
    );
    let inputs = Features::inputs(system, form);
    let moving = form.view == View::Moving;
    text.define([("INPUTS", inputs), ("LDX", padded(inputs)), ("LANES", LANES)]);
    text.define([("SITUATED", Features::situated(robot)), ("MOVING", moving)].map(|(name, on)| (name, i32::from(on))));
    let time = if form.base == Base::Trapezoid { system.frame_time } else { 0.0 };
    text.define(
        [("TRAPEZOID", time), ("FRAME_TIME", system.frame_time), ("NEAR", NEAR)].map(|(name, x)| (name, number(x))),
    );
    let (inputs, outputs) = (&normalizer.inputs, &normalizer.outputs);
    text.table("int", "WAVES", robot.joints().map(|joint| if moving { waves(joint) as f64 } else { 0.0 }));
    text.table("real", "SEEN", robot.contact_points.iter().map(|p| p.threshold()));
    text.table("real", "MEAN", inputs.mean.iter().copied());
    text.table("real", "SCALE", inputs.scale());
    text.table("real", "RATE", inputs.scale().map(f64::recip));
    text.table("double", "SHIFT", outputs.mean.iter().copied());
    text.table("double", "STRETCH", outputs.scale());
    text.0 + include_str!("tokens.cuh")
}
