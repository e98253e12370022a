//! Everything around the network of a robot that is one token: from outputs to the change of a state, and the adjoint of a frame.

use crate::prelude::*;
use crate::slopes::{Seen, apply_back, token_back};
use crate::trapezoid;
use crate::{base::Base, features::Features, form::Form, normalizer::Normalizer};

/// Meaning of a robot's tokens and predictions.
#[derive(Clone)]
pub struct Around {
    /// The robot.
    pub system: Arc<System>,
    /// On [`Base::State`] or [`Base::Trapezoid`].
    pub form: Form,
    /// The network's normalizer.
    pub normalizer: Normalizer,
}

impl Around {
    /// Predicted change, in units of the state.
    pub fn change<'a>(&'a self, outputs: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        let moments = &self.normalizer.outputs;
        outputs.iter().zip(moments.scale().zip(&moments.mean)).map(|(x, (scale, mean))| f64::from(*x) * scale + mean)
    }

    /// Gradient with respect to the network's outputs, from the `upstream` gradient with respect to the state after the frame (tangent
    /// space). Adds the direct part with respect to the state before the frame to `slope`.
    pub fn outputs_back(&self, before: &[f64], outputs: &[f32], upstream: &[f64], slope: &mut [f64]) -> Vec<f32> {
        let (robot, time, prediction) = (&self.system.robot, self.system.frame_time, self.change(outputs).collect::<Vec<_>>());
        let (mut change, mut by_change) = (prediction.clone(), vec![0.0; before.len()]);
        if self.form.base == Base::Trapezoid {
            trapezoid::carry(robot, time, before, &mut change, 1.0);
        }
        apply_back(robot, before, &change, upstream, slope, &mut by_change);
        if self.form.base == Base::Trapezoid {
            trapezoid::back(robot, time, before, &prediction, &mut by_change, slope);
        }
        by_change.iter().zip(self.normalizer.outputs.scale()).map(|(g, scale)| (g * scale) as f32).collect()
    }

    /// Adds to `slope` the gradient with respect to the state, from the gradient with respect to its normalised token. Returns the gradient
    /// with respect to the token's own numbers.
    pub fn token_back(
        &self,
        state: &[f64],
        (contacts, gravity): (&[ContactEvent], Vector3<f64>),
        by_token: &[f32],
        data: &mut Data,
        slope: &mut [f64],
    ) -> Vec<f64> {
        let by: Vec<f64> = by_token.iter().zip(self.normalizer.inputs.scale()).map(|(g, scale)| f64::from(*g) / scale).collect();
        let seen = Seen { state, contacts, gravity, view: self.form.view, frame_time: self.system.frame_time };
        token_back(&self.system.robot, &seen, &by, data, slope);
        by
    }

    /// The torques' part of the gradient with respect to a token's numbers.
    pub fn of_torques<'a>(&self, by_token: &'a [f64]) -> &'a [f64] {
        &by_token[Features::torques(&self.system, self.form)..][..self.system.robot.joint_count()]
    }
}
