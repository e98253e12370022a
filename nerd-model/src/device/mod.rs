//! Everything around the network, as a program for a GPU: the text of two kernels, `neural_tell` and `neural_apply`; and a small network
//! itself as one kernel, `whole_pass`. [`crate::chain`] has the kernels around a chain's network.
//!
//! They build on the articulated solver's kernels ([`nerd_sim::articulated::device`]). Like those they are plain C++ beside CUDA, so that a
//! test runs them where there is no GPU.

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

/// Threads that write an environment's token.
pub const LANES: usize = 4;

/// The pass of a program over windows of `tokens` tokens `[T][padded inputs]`: of a chain, or in f16 of a residual network
/// (`program/networks.rs`). `None` for other networks, or where it does not fit.
pub fn whole_program(program: &Program, tokens: usize, products: Products) -> Option<Whole> {
    if products == Products::F16 { residual::residual(program).filter(|_| tokens == 1) } else { whole::chain(program, tokens) }
}

/// The text for models of `system` with a form and a normaliser, for scenes of this reach.
pub fn program(form: Form, normalizer: &Normalizer, system: &Arc<System>, real: Real, reach: Reach) -> String {
    token_functions(form, normalizer, system, real, reach) + include_str!("tokens_frame.cuh")
}

/// In 64 bits, a frame and its adjoint as the kernels `slopes_look`, `slopes_said` and `slopes_back`, with the network between them.
pub fn slope_program(form: Form, normalizer: &Normalizer, system: &Arc<System>, reach: Reach) -> String {
    slope_functions(form, normalizer, system, reach) + include_str!("slopes_frame.cuh")
}

/// The same without its kernels: `tell`, `advance`, `said_back` and `frame_back`, for other kernels.
pub fn slope_functions(form: Form, normalizer: &Normalizer, system: &Arc<System>, reach: Reach) -> String {
    token_functions(form, normalizer, system, Real::F64, reach) + include_str!("tokens_back.cuh")
}

/// Functions around the network without kernels: `tell` and `apply`, for other kernels.
pub fn token_functions(
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
    let (inputs, moving) = (Features::inputs(system, form), form.view == View::Moving);
    text.define([("INPUTS", inputs), ("LDX", padded(inputs)), ("LANES", LANES)]);
    text.define([("SITUATED", Features::situated(robot)), ("MOVING", moving)].map(|(name, on)| (name, i32::from(on))));
    let time = if form.base == Base::Trapezoid { system.frame_time } else { 0.0 };
    text.define([("TRAPEZOID", time), ("FRAME_TIME", system.frame_time), ("NEAR", NEAR)].map(|(name, x)| (name, number(x))));
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
