//! The computation around a robot's network: from outputs to the change of the state. The adjoint of a frame is for
//! networks that read one token.

use crate::gradients::{Seen, apply_back, token_back};
use crate::prelude::*;
use crate::trapezoid;
use crate::{base::Base, features::Features, form::Form, normalizer::Normalizer};

/// What gives a robot's tokens and predictions their meaning.
#[derive(Clone)]
pub struct Around {
    /// The robot.
    pub system: Arc<System>,
    /// Base and view of tokens and predictions.
    pub form: Form,
    /// Shift and scale of tokens and predictions.
    pub normalizer: Normalizer,
}

impl Around {
    /// Predicted change of the state, `[state dim]`, in SI units, from normalised `outputs`.
    pub fn change<'a>(&'a self, outputs: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        let moments = &self.normalizer.outputs;
        outputs.iter().zip(moments.scale().zip(&moments.mean)).map(|(x, (scale, mean))| f64::from(*x) * scale + mean)
    }

    /// Gradient with respect to the network's outputs, from `upstream[2 nv]`, the gradient with respect to the state
    /// after the frame (tangent space). Adds the direct part with respect to the state before the frame to
    /// `gradient[2 nv]`.
    pub fn outputs_back(&self, before: &[f64], outputs: &[f32], upstream: &[f64], gradient: &mut [f64]) -> Vec<f32> {
        let robot = &self.system.robot;
        let time = self.system.frame_time;
        let prediction = self.change(outputs).collect::<Vec<_>>();
        let (mut change, mut by_change) = (prediction.clone(), vec![0.0; before.len()]);
        if self.form.base == Base::Trapezoid {
            trapezoid::carry(robot, time, before, &mut change, 1.0);
        }
        apply_back(robot, before, &change, upstream, gradient, &mut by_change);
        if self.form.base == Base::Trapezoid {
            trapezoid::back(robot, time, before, &prediction, &mut by_change, gradient);
        }
        by_change.iter().zip(self.normalizer.outputs.scale()).map(|(g, scale)| (g * scale) as f32).collect()
    }

    /// Adds to `gradient[2 nv]` the gradient with respect to the state, from the gradient with respect to its
    /// normalised token. Returns the gradient with respect to the unnormalised token.
    pub fn token_back(
        &self,
        state: &[f64],
        (contacts, gravity): (&[ContactEvent], Vector3<f64>),
        by_token: &[f32],
        data: &mut Data,
        gradient: &mut [f64],
    ) -> Vec<f64> {
        let by: Vec<f64> =
            by_token.iter().zip(self.normalizer.inputs.scale()).map(|(g, scale)| f64::from(*g) / scale).collect();
        let seen = Seen { state, contacts, gravity, view: self.form.view, frame_time: self.system.frame_time };
        token_back(&self.system.robot, &seen, &by, data, gradient);
        by
    }

    /// The torques' part, `[joint]`, of a gradient with respect to an unnormalised token.
    pub fn of_torques<'a>(&self, by_token: &'a [f64]) -> &'a [f64] {
        &by_token[Features::torques(&self.system, self.form)..][..self.system.robot.joint_count()]
    }
}
