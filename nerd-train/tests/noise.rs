//! Noise moves the velocities that a learner sees, not what it should answer with: the state recorded next.

use nerd_model::form::Form;
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::prelude::*;
use nerd_train::prepare::generate;
use nerd_train::windows::Windows;

fn made(noise: f64) -> Windows {
    let system = System::named("cartpole").unwrap();
    let truth = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb))) };
    let config = GenerateConfig { transitions: 2000, frames: 50, noise, ..Default::default() };
    generate(&system, &truth, &config, 1, Form::default(), &|_| ()).unwrap().windows
}

#[test]
fn noisy_velocities_lead_to_the_same_next_state() {
    // A token of a Cartpole is its state (x, theta, their rates) and torques, a target the change of that state.
    let (plain, noisy) = (made(0.0), made(0.1));
    let rows = |w: &Windows| {
        let pairs = w.x.chunks_exact(w.inputs).zip(w.y.chunks_exact(w.outputs));
        pairs.map(|(x, y)| (x[..4].to_vec(), (0..4).map(|k| x[k] + y[k]).collect::<Vec<_>>())).collect::<Vec<_>>()
    };
    let (mut spread, mut change) = ([0.0f64; 2], [0.0f64; 2]);
    for ((x, next), (moved, there)) in rows(&plain).iter().zip(&rows(&noisy)) {
        assert_eq!(x[..2], moved[..2], "positions are seen as they are");
        for k in 2..4 {
            spread[k - 2] += f64::from(moved[k] - x[k]).powi(2);
            change[k - 2] += f64::from(next[k] - x[k]).powi(2);
            assert!((next[k] - there[k]).abs() < 1e-4, "rate {k}: {} recorded, {} answered", next[k], there[k]);
        }
    }
    for k in 0..2 {
        let found = (spread[k] / change[k]).sqrt();
        assert!((0.09..0.11).contains(&found), "noise is {found:.3} of the change over a frame, 0.1 was asked for");
    }
}
