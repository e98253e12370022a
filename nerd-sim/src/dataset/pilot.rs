//! Policies that act in a trajectory instead of random torques, so that data holds their motions.

use std::fmt::Debug;
use std::sync::Arc;

use rand_chacha::ChaCha8Rng;

use crate::scene::Scene;
use crate::system::System;

/// Takes over trajectories. Its `Debug` says what decides their bytes.
pub trait Pilot: Debug + Send + Sync {
    /// A trajectory's start `[q, qd]`, and who acts in it.
    fn launch(&self, system: &Arc<System>, rng: &mut ChaCha8Rng) -> (Vec<f64>, Box<dyn Act>);
}

/// Acts in one trajectory.
pub trait Act {
    /// Torques of the next frame, one a joint.
    fn torques(&mut self, state: &[f64], scene: &Scene, rng: &mut ChaCha8Rng, out: &mut [f64]);
}
