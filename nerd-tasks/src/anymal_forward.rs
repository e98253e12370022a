//! ANYmal walks forward, along world +x, at 1 m/s (paper A.3.1.4). Frames, observation, action, reward: [`crate::anymal`].

use crate::anymal::Anymal;

/// The task.
pub const ANYMAL_FORWARD: Anymal = Anymal { name: "anymal-forward", velocity: [1.0, 0.0] };
