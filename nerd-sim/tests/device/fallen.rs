//! Crates that fall on static geoms of an MJCF's world.

use super::*;

impl Case {
    /// Crates that start over four positions in turn, within `about` (m) of them, and have fallen for `frames` frames.
    pub(super) fn fallen(text: &str, places: [[f64; 3]; 4], about: f64, frames: usize) -> Self {
        let system = Arc::new(System::from_text("crate", text, Some("like = \"urdf\"")).expect("a robot"));
        let mut batch = batch(&system, "ground", 40);
        let d = system.robot.state_dim();
        for (env, state) in batch.states.chunks_exact_mut(d).enumerate() {
            let (k, [x, y, z]) = (env as f64, places[env % 4]);
            state.copy_from_slice(&system.default_state());
            (state[0], state[1], state[2]) = (x + about * (1.3 * k).sin(), y + about * (2.3 * k).cos(), z);
            (state[8], state[9]) = (2.0 * k.sin(), (0.7 * k).cos());
        }
        let config = ArticulatedConfig::accurate(&system);
        let mut solver = Articulated::new(config);
        (0..frames).for_each(|_| solver.step(&mut batch, &[0.0; 40]).expect("it can be stepped"));
        Self { batch, torques: vec![0.05; 40], config }
    }

    /// Fails unless some contact points are near every collider.
    pub(super) fn touches_all(&self, colliders: usize) {
        let Batch { system, scenes, states, .. } = &self.batch;
        let (mut data, mut events, mut near) = (system.data(), Vec::new(), vec![0; colliders]);
        for state in states.chunks_exact(system.robot.state_dim()) {
            contacts(system, &scenes[0], state, &mut data, &mut events);
            let points = &system.robot.contact_points;
            events
                .iter()
                .zip(points)
                .filter(|(e, p)| e.distance < p.radius + 0.02)
                .for_each(|(e, _)| near[e.collider] += 1);
        }
        assert!(near.iter().all(|n| *n > 0), "by collider {near:?} points are near: not all are tried");
    }
}
