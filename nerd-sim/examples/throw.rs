//! Throws a cube to a place by slopes (`docs/slopes.md`).

use nerd_sim::prelude::*;

/// Throws a cube so that it comes to lie at a place: 60 frames, through flight, impact and friction.
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
        // Half the square of that, by the way of the root in its own axes.
        let mut slope = vec![0.0; 12];
        slope[3..6].copy_from_slice(quaternion(&end[3..7]).inverse_transform_vector(&miss).as_slice());
        for batch in path[..frames].iter().rev() {
            slope = solver.back(batch, &[], 1, &slope)?.states;
        }
        // The cube starts upright and at rest: its own axes are the world's, and its velocity is the state's.
        (0..3).for_each(|k| start[10 + k] -= 2.0 * slope[9 + k]);
    }
    Ok(())
}
