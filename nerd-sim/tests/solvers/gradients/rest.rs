//! Gradients and continuity of a frame that begins at full rest.

use nerd_sim::prelude::*;
use rand::RngExt;

use super::super::common::differences::*;
use super::super::common::*;
use super::{HELD, begun, four};

/// At full rest normal velocities are about 1e-10 m/s: a law that jumps where they change sign makes the state jump.
#[test]
fn next_states_at_rest_change_little_and_have_gradients() {
    for name in ["ant", "anymal"] {
        let system = built_in(name);
        let (robot, mut random) = (&system.robot, stream(6, 0));
        let (mut batch, joints, coords) = (begun(&system, "ground", 4), robot.joint_count(), robot.nq());
        (0..400).for_each(|_| implicit(4).step(&mut batch, &vec![0.0; 4 * joints]).expect("steps"));
        let (mut errors, mut left_out) = (Vec::new(), 0);
        for env in 0..batch.len() {
            let (state, torques) =
                (batch.state(env), (0..joints).map(|_| random.random_range(-0.2..=0.2)).collect::<Vec<f64>>());
            let next = stepped(&mut settled(four()), &batch, state, &torques);
            for column in coords..state.len() {
                let mut moved = state.to_vec();
                moved[column] += 1e-9;
                let change = stepped(&mut settled(four()), &batch, &moved, &torques);
                let most = change.iter().zip(&next).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
                assert!(
                    most < 1e-7,
                    "{name}, environment {env}: 1e-9 in rate {} moves the next state by {most:.1e}",
                    column - coords
                );
            }
            match errors_at_rest(&batch, state, &torques) {
                Some(error) => errors.push(error),
                None => left_out += 1,
            }
        }
        println!(
            "{name} at rest: {} states, {left_out} left out, error {:.1e} (worst)",
            batch.len(),
            errors.iter().fold(0.0f64, |a, b| a.max(*b))
        );
        assert!(!errors.is_empty() && errors.iter().all(|error| *error < HELD), "{name}: {errors:?}");
    }
}

/// As [`error`], with differences so small that no point comes or leaves within them.
fn errors_at_rest(batch: &Batch, state: &[f64], torques: &[f64]) -> Option<f64> {
    errors(&mut settled(four()), batch, state, torques, [1e-6, 1e-3], (HELD, false))
        .map(|errors| errors[0].max(errors[1]))
}
