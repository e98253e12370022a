//! Tasks as formulas, written once for any kind of number: with f64 they are what the CPU reckons, with [`Text`] the same steps are written
//! down as a program for a graphics card. So a task of one's own that is [`Formulas`] runs there like the built-in ones.
//!
//! ```
//! use nerd_sim::system::System;
//! use nerd_tasks::Task;
//! use nerd_tasks::formula::{About, Formulas, Number, Sight};
//!
//! /// Hold the Cartpole's pole upright, near the middle of the rail. A state is (x, theta, x_dot, theta_dot).
//! struct Balance;
//!
//! impl Formulas for Balance {
//!     fn about(&self) -> About {
//!         About { name: "balance", robot: "cartpole", scene: "free", observation: 4, action: 1, steps: 200, frames: 1 }
//!     }
//!     fn observe<N: Number>(&self, s: &mut impl Sight<N>, out: &mut [N]) {
//!         out.copy_from_slice(&[s.q(0), s.q(1), s.qd(0), s.qd(1)]);
//!     }
//!     fn act<N: Number>(&self, _: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
//!         torques.copy_from_slice(&[N::from(400.0) * action[0], N::from(0.0)]);
//!     }
//!     fn reward<N: Number>(&self, s: &mut impl Sight<N>, _: &[N]) -> N {
//!         N::from(1.0) - s.q(0).squared() - s.q(1).squared()
//!     }
//!     fn over<N: Number>(&self, s: &mut impl Sight<N>) -> N {
//!         N::from(2.0).below(s.q(0).abs()).or(N::from(0.5).below(s.q(1).abs()))
//!     }
//! }
//!
//! // The same as a task, and as a program.
//! let task: Box<dyn Task> = Box::new(Balance);
//! assert_eq!((task.name(), task.observation_dim()), ("balance", 4));
//! let program = task.kernels(&*System::named("cartpole").unwrap(), 0).unwrap();
//! assert!(program.contains("torques[0] = n1;"), "{program}");
//! ```

mod about;
mod number;
mod seen;
mod text;

pub use about::{About, Formulas};
pub use number::Number;
pub use seen::Sight;
pub use text::{Tape, Text, written};
