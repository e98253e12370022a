//! A cable, hose or rope as a robot: a chain of rods, with hinges between them that bend and twist like it.
//!
//! `[cable]` in a TOML holds a data sheet; all other keys of a robot's TOML may follow. Rods are rigid and of equal length l. Two
//! neighbours are joined by a hinge for each direction of bending and, if the cable twists, one along the rod, with springs of `E I / l`
//! and `G J / l`. A clamp of the first rod has the compliance of half a rod, `2 E I / l`, so that a cantilever sags as a beam does.
//!
//! ```
//! use nerd_sim::prelude::*;
//! let toml = "[cable]\nlength = 0.5\ndiameter = 0.006\nmass = 0.03\nbending = 1e-3\nlinks = 10\nheld = \"fixed\"";
//! let system = System::from_toml("lead", toml)?;
//! assert_eq!(system.robot.joint_count(), 20);
//! # Ok::<(), SystemError>(())
//! ```

mod robot;
mod spec;

pub use spec::{CableSpec, Held};
