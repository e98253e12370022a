//! A cable, hose or rope as a robot: a chain of rigid rods with sprung hinges for bending and twisting.
//!
//! `[cable]` in a TOML holds a data sheet; all other keys of a robot's TOML may follow. Rods have equal length l.
//! Neighbours are joined by two bending hinges with springs `E I / l`. Cables that twist have a third hinge along the
//! rod with a spring `G J / l`. The clamp of the first rod has half a rod's compliance (spring `2 E I / l`), so a
//! cantilever sags like a beam.
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

pub use spec::{CableSpec, Support};
