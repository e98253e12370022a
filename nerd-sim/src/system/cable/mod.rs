//! A cable, hose or rope as a robot: a chain of rods, with hinges between them that bend and twist like it.
//!
//! `[cable]` in a TOML says what a data sheet says; all other keys of a robot's TOML may stand beside it. Rods are rigid and of equal length
//! l. Between two of them stand a hinge for each direction of bending and, if it twists, one along the rod, with springs of `E I / l` and
//! `G J / l`. Where its first rod is clamped there is half a rod's give, `2 E I / l`: a cantilever then sags as a beam does.
//!
//! ```
//! use nerd_sim::prelude::*;
//! let toml = "[cable]\nlength = 0.5\ndiameter = 0.006\nmass = 0.03\nbending = 1e-3\nlinks = 10\nheld = \"fixed\"";
//! let system = System::from_toml("lead", toml)?;
//! assert_eq!(system.robot.joint_count(), 20);
//! # Ok::<(), SystemError>(())
//! ```

mod defaults;
mod robot;
mod spec;

pub use spec::{CableSpec, Held};
