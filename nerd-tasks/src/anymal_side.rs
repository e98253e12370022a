//! ANYmal walks sideways, along world +z, at 1 m/s (paper A.3.1.4). Frames, observation, action, reward: [`crate::anymal`].

use crate::anymal::Anymal;

/// The task.
pub const ANYMAL_SIDE: Anymal = Anymal { name: "anymal-side", velocity: [0.0, 1.0] };
