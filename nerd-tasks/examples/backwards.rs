//! A task on a free base: an Ant that runs backwards. `cargo run --release -p nerd-tasks --example backwards`

use nerd_sim::prelude::*;
use nerd_tasks::body::{Body, observe};
use nerd_tasks::formula::{Formulas, Number, Sight};
use nerd_tasks::{About, Episodes, Task};

/// Run along world -x while facing +x. World up is +y for the Ant.
struct Backwards;

impl Formulas for Backwards {
    fn about(&self) -> About {
        About { name: "ant-backwards", robot: "ant", scene: "ground", observation: 29, action: 8, steps: 500, frames: 1 }
    }
    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        observe(sight, out); // height, quaternion, p_dot, w, joints, joint velocities, up, heading
    }
    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        sight.controlled(action, torques); // the robot's own gains: a unit action is 400 N m
    }
    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _: &[N]) -> N {
        let Body { linear, up, heading, .. } = Body::of(sight); // p_dot in world axes (m/s)
        heading + N::from(0.1) * up - linear[0]
    }
    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        Body::of(sight).height.below(N::from(0.3))
    }
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
