//! A task for a floating base: an Ant that runs backwards. `cargo run --release -p nerd-tasks --example backwards`

use nerd_sim::prelude::*;
use nerd_tasks::formula::{Number, Sight, Traced};
use nerd_tasks::{About, Episodes, Task};

/// Run along world -x while facing +x. For the Ant, world up is +y.
struct Backwards;

impl Task for Backwards {
    fn about(&self) -> About {
        About {
            name: "ant-backwards",
            robot: "ant",
            scene: "ground",
            observation: 27,
            action: 8,
            steps: 500,
            frames: 1,
        }
    }
    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out[0] = sight.q(1); // height
        out[1..4].copy_from_slice(&velocity(sight));
        (0..12).for_each(|k| out[4 + k] = sight.q(3 + k)); // quaternion, joints
        (0..3).for_each(|k| out[16 + k] = sight.qd(k)); // angular velocity
        (0..8).for_each(|k| out[19 + k] = sight.qd(6 + k)); // joint velocities
    }
    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        sight.controlled(action, torques); // the robot's controller: a unit action is 400 N m
    }
    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        // World-x component of the body's x axis, 1 when facing forward.
        let heading = 1.0 - 2.0 * (sight.q(4).squared() + sight.q(5).squared());
        heading - velocity(sight)[0]
    }
    fn terminated<'a>(&self, sight: &Sight<'a>) -> Traced<'a> {
        sight.q(1).below(0.3.into())
    }
}

/// Velocity of the base `v + w x p` (m/s), world axes.
fn velocity<'a>(sight: &Sight<'a>) -> [Traced<'a>; 3] {
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
