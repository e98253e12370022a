//! Finds the throw that lands a cube at a given place, by gradient descent through the simulation
//! (`docs/gradients.md`).

use nerd_sim::prelude::*;

/// Throws of 60 frames through flight, impact and friction; the initial linear velocity is optimised.
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, frames, place) = (System::named("cube")?, 60, Vector3::new(1.0, 0.5, 0.0));
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let scene = system.scene("ground")?;
    let mut start = system.default_state();
    start[2] = 0.3;
    for round in 0..30 {
        let mut path = vec![Batch::new(&system, &scene, 1)];
        path[0].reset(0, &start);
        for frame in 0..frames {
            let mut next = path[frame].clone();
            solver.step(&mut next, &[])?;
            path.push(next);
        }
        let end = path[frames].state(0);
        let mut miss = vector(end) - place;
        miss.z = 0.0;
        println!("throw {round} misses by {:.3} m", miss.norm());
        // Gradient of half the squared distance, with respect to the root's position in the root's axes.
        let mut gradient = vec![0.0; 12];
        gradient[3..6].copy_from_slice(quaternion(&end[3..7]).inverse_transform_vector(&miss).as_slice());
        for batch in path[..frames].iter().rev() {
            gradient = solver.vjp(batch, &[], 1, &gradient)?.states;
        }
        // The cube starts upright and without angular velocity, so its tangent velocity is the state's linear velocity.
        (0..3).for_each(|k| start[10 + k] -= 2.0 * gradient[9 + k]);
    }
    Ok(())
}
