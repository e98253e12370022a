//! Articulated-body dynamics: steps a robot by one frame with RNEA, CRBA, Cholesky (nerd-core) and compliant contact.
//!
//! A frame without contact is integrated by RK4 or symplectic Euler. A frame with contact takes substeps of symplectic
//! Euler under the compliant contact of [`force`], or implicit substeps ([`ContactStep::Implicit`]). A frame with a
//! joint too stiff for explicit substeps is repeated with implicit ones under any preset. An implicit frame that gains
//! energy is repeated with more substeps. Models and policies learn from preset `accurate`; `paper` reproduces the
//! reference simulator; errors are measured against `converged`. An environment without collider or contact point runs
//! no contact code.
//!
//! Where contact and its friction are computed:
//!
//! | | CPU | GPU (`device/`) |
//! |---|---|---|
//! | explicit substeps | `explicit.rs`, [`force`] | none: `explicit.cuh` is without contact |
//! | implicit substeps: equations | `implicit.rs` | `implicit.cuh` |
//! | the points that touch | `find.rs` | `touch.cuh` |
//! | law of friction: a drag (N s/m) | `drag` in `force.rs`, `stick.rs` | `drag`, `breaking` in `touch.cuh` |
//! | thetas and first drag | `set_thetas` in `touch.rs` | `set_thetas` in `implicit.cuh` |
//! | force at this drag | `push` in `touch.rs` | `push` in `press.cuh` |
//! | solves for accelerations | `kick.rs`, `press.rs`, `along.rs` | `implicit.cuh`, `press.cuh`, `along.cuh` |
//! | force and next drag, after a solve | `settle` in `touch.rs` | `update_touches` in `press.cuh` |
//! | torsional and rolling friction | `turning.rs` | `touch.cuh`, `press.cuh`, where `TURNS` |
//! | self-collision | `fold.rs` | `fold.cuh` |
//! | derivatives | `gradients/law.rs`, `gradients/contact_law.rs`, `gradients/turn.rs` | `law.cuh` |
//!
//! Two places compute a joint's own forces. `explicit.rs` (`accelerate`) computes them for explicit substeps.
//! `implicit.rs` (`Damped`), `find.rs` (limits, drives, dry friction, springs) and `kick.rs` compute them for implicit
//! substeps. Forces in `System::held` have no explicit part, since they make every frame implicit. `stiff.rs` decides
//! which other forces are too stiff for explicit substeps. `gradients` differentiates a joint's forces, and `device`
//! computes them in kernels. [`force`] serves contact alone.

mod along;
mod config;
pub mod device;
mod energy;
mod explicit;
mod fast;
mod find;
mod fold;
pub mod force;
mod frame;
mod gradients;
mod implicit;
mod kept;
mod kick;
mod memory;
mod press;
mod solver;
mod spin;
mod stick;
mod stiff;
mod touch;
mod touches;
mod turning;
mod workspace;

pub use crate::system::Refresh;
pub use along::along;
pub use config::{ArticulatedConfig, ContactStep, Friction, Integrator};
pub use gradients::numbers;
pub use solver::Articulated;
