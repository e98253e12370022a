//! Chains: cables led by a gripper, learned rod by rod.
//!
//! The network sees each rod's direction and its rate in world axes, instead of joint angles. So an error in one rod
//! does not rotate all rods after it. A rod is a token, the chain a window, and one pass of a small network
//! (`program/networks.rs`) predicts a frame:
//!
//! ```text
//! state ── Chain::rods ──▶ rods ── look ──▶ tokens ── network ──▶ output ── advance ──▶ rods ── Chain::state ──▶ state
//!                           ▲ contacts of the scene, the gripper's glide
//! ```
//!
//! Every step of this computation has an adjoint, for training through rollouts of many frames.

mod device;
mod features;
mod gripper;
mod layout;
mod rods;
mod solver;
mod step;

pub use device::{chain_functions, chain_program, numbers};
pub use features::{INPUTS, Look};
pub use gripper::Gripper;
pub use layout::{Chain, NoChain};
pub use rods::Rods;
pub use solver::ChainSolver;
pub use step::{OUTPUTS, Outputs};
