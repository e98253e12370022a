//! A ball that rolls keeps its height and its energy at any speed and with any number of substeps.

use nerd_sim::prelude::*;
use nerd_sim::suite::bodies::{Body, UPRIGHT};

/// `m g / k` below the surface and with the energy of the start, whatever the look-ahead: a ball's touching place has no acceleration
/// though its root's spatial acceleration is `-w x v`, 250 m/s^2 at 5 m/s.
#[test]
fn a_rolling_ball_neither_hops_nor_gains_energy() {
    let (radius, mass, inertia, k) = (0.1, 1.0, 0.004, 1e4);
    let sunk = mass * 9.81 / k;
    for friction in [0.0, 0.5] {
        let body = Body { shape: r#"<sphere radius="0.1"/>"#.into(), inertia: [inertia; 3], ..Default::default() };
        let system = Body { material: [k, 100.0, 1e3, friction], ..body }.system().expect("a ball");
        for (substeps, speed) in [1, 2, 4, 8, 16, 64].into_iter().flat_map(|n| [1.0, 5.0, 10.0, 20.0].map(|v| (n, v))) {
            // The ball's lowest place stands still.
            let spin = speed / radius;
            let mut batch = Batch::new(&system, &system.scene("ground").expect("ground"), 1);
            batch.reset(0, &Body::state([0.0, 0.0, radius - sunk], UPRIGHT, [0.0, spin, 0.0], [speed, 0.0, 0.0]));
            let mut solver = Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb));
            let (mut off, mut energies) = (0.0f64, Vec::new());
            for _ in 0..300 {
                let s = batch.state(0);
                let (p, w, v) = ([s[0], s[1], s[2]], [s[7], s[8], s[9]], [s[10], s[11], s[12]]);
                let at_centre = nalgebra::Vector3::from(v) + nalgebra::Vector3::from(w).cross(&nalgebra::Vector3::from(p));
                let squares = mass * at_centre.norm_squared() + inertia * w.iter().map(|w| w * w).sum::<f64>();
                energies.push(0.5 * squares + mass * 9.81 * p[2] + 0.5 * k * (radius - p[2]).max(0.0).powi(2));
                off = off.max((p[2] - (radius - sunk)).abs());
                solver.step(&mut batch, &[]).expect("finite");
            }
            let gain = energies.iter().map(|e| (e / energies[0] - 1.0).abs()).fold(0.0, f64::max);
            let what = format!("{speed} m/s, friction {friction}, {substeps} substeps: height {off:.1e} m, energy {gain:.1e}");
            println!("{what}");
            assert!(off < 1e-4 && gain < 1e-5, "{what}");
        }
    }
}
