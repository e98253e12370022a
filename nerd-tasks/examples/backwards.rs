//! A task on a free base: an Ant that runs backwards. `cargo run --release -p nerd-tasks --example backwards`

use nerd_sim::prelude::*;
use nerd_tasks::formula::{Formulas, Number, Sight};
use nerd_tasks::{About, Episodes, Task};

/// Run along world -x while facing +x. World up is +y for the Ant.
struct Backwards;

impl Formulas for Backwards {
    fn about(&self) -> About {
        About { name: "ant-backwards", robot: "ant", scene: "ground", observation: 27, action: 8, steps: 500, frames: 1 }
    }
    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        out[0] = sight.q(1); // height
        out[1..4].copy_from_slice(&velocity(sight));
        (0..12).for_each(|k| out[4 + k] = sight.q(3 + k)); // quaternion, joints
        (0..3).for_each(|k| out[16 + k] = sight.qd(k)); // angular velocity
        (0..8).for_each(|k| out[19 + k] = sight.qd(6 + k)); // joint velocities
    }
    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        sight.controlled(action, torques); // the robot's own gains: a unit action is 400 N m
    }
    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _: &[N]) -> N {
        // World-x component of the body's x axis, 1 when it faces forward.
        let heading = N::from(1.0) - N::from(2.0) * (sight.q(4).squared() + sight.q(5).squared());
        heading - velocity(sight)[0]
    }
    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        sight.q(1).below(N::from(0.3))
    }
}

/// Velocity of the base `v + w x p` (m/s), world axes.
fn velocity<N: Number>(sight: &impl Sight<N>) -> [N; 3] {
    let cross = |i: usize, k: usize| sight.qd(i) * sight.q(k) - sight.qd(k) * sight.q(i);
    [0, 1, 2].map(|axis| sight.qd(3 + axis) + cross((axis + 1) % 3, (axis + 2) % 3))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named(Backwards.robot())?;
    let batch = Batch::new(&system, &system.scene(Backwards.scene())?, 4);
    let solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let mut episodes = Episodes::new(Box::new(Backwards), Simulation::new(batch, solver), 0);
    let step = episodes.step(&[0.1; 4 * 8])?;
    println!("rewards of four Ants after a step: {:.3?}", step.rewards);
    Ok(())
}
