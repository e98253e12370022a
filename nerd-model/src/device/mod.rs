//! What surrounds the network, as a program for a device: the text of two kernels, `neural_tell` and `neural_apply`; and a small network
//! itself as one kernel, `whole_pass`. Around a chain's network are those of [`crate::chain`].
//!
//! They build on the articulated solver's ([`nerd_sim::articulated::device`]), and like those are plain C++ beside CUDA, so that a test
//! runs them where there is no GPU.

mod whole;

use std::fmt::Write;
use std::sync::Arc;

use nerd_sim::articulated::device::{Reach, Real, functions};
use nerd_sim::articulated::{ArticulatedConfig, Friction};
use nerd_sim::system::System;

use crate::base::Base;
use crate::features::{Features, NEAR, waves};
use crate::form::{Form, View};
use crate::normalizer::Normalizer;

pub use crate::program::op::padded;
pub use whole::{Products, Whole, whole_program};

/// The settings with which scenes are put in order for a model's kernels; or what of it has no kernel, and where it can be stepped.
pub fn settings(Form { base, view }: Form) -> Result<ArticulatedConfig, String> {
    let refuse =
        |what: String| Err(format!("a model {what}, which has no kernel; step it with the network alone on the device, or on the CPU"));
    if !view.own() {
        return refuse(format!("whose view is {view:?}"));
    }
    match base {
        Base::Nothing => refuse("that predicts states".into()),
        Base::State | Base::Trapezoid => Ok(ArticulatedConfig::implicit(1, Friction::Coulomb)),
    }
}

/// The text for models of `system` of a form and with a normaliser, for scenes of at most so many colliders; an error as of [`settings`].
pub fn program(form: Form, normalizer: &Normalizer, system: &Arc<System>, real: Real, colliders: usize) -> Result<String, String> {
    Ok(token_functions(form, normalizer, system, real, colliders)? + include_str!("tokens_frame.cuh"))
}

/// The same without its kernels: `tell` and `apply`, for other kernels.
pub fn token_functions(form: Form, normalizer: &Normalizer, system: &Arc<System>, real: Real, colliders: usize) -> Result<String, String> {
    let config = settings(form)?;
    let robot = &system.robot;
    let mut text = functions(system, &config, real, Reach { colliders, ..Reach::default() });
    let inputs = Features::inputs(system, form);
    let flag = |on: bool| usize::from(on);
    let situated = flag(Features::situated(robot));
    for (name, n) in [("INPUTS", inputs), ("LDX", padded(inputs)), ("SITUATED", situated), ("MOVING", flag(form.view == View::Moving))] {
        let _ = writeln!(text, "#define {name} {n}");
    }
    let time = if form.base == Base::Trapezoid { system.frame_time } else { 0.0 };
    for (name, x) in [("TRAPEZOID", time), ("FRAME_TIME", system.frame_time), ("NEAR", NEAR)] {
        let _ = writeln!(text, "#define {name} {x:e}");
    }
    let (inputs, outputs) = (&normalizer.inputs, &normalizer.outputs);
    let mut table = |kind: &str, name: &str, numbers: Vec<f64>| {
        // None may be empty.
        let entries: Vec<String> = numbers.into_iter().chain([0.0]).map(|x| format!("({kind}){x:e}")).collect();
        let _ = writeln!(text, "TABLE {kind} {name}[] = {{{}}};", entries.join(", "));
    };
    let ends = |joint| if form.view == View::Moving { waves(joint) as f64 } else { 0.0 };
    table("int", "WAVES", robot.joints().map(ends).collect());
    table("real", "SEEN", robot.contact_points.iter().map(|p| p.threshold()).collect());
    table("real", "MEAN", inputs.mean.clone());
    table("real", "SCALE", inputs.scale().collect());
    table("double", "SHIFT", outputs.mean.clone());
    table("double", "STRETCH", outputs.scale().collect());
    text.push_str(include_str!("tokens.cuh"));
    Ok(text)
}
