//! Trajectories of equal length: recorded by a solver, read from shards or cut from logs; trajectory-major.

use sha2::{Digest, Sha256};

use crate::internal::*;

/// Trajectories of F frames each, with states before and after each frame.
#[derive(Clone, Debug, Default)]
pub struct Trajectories {
    /// Number of trajectories.
    pub count: usize,
    /// Number of frames F per trajectory.
    pub frames: usize,
    /// Scene of each trajectory. Shards do not store scenes: empty if only a shard is known.
    pub scenes: Vec<Arc<Scene>>,
    /// Robot of each trajectory; empty where all are equal, and if only a shard is known.
    pub systems: Vec<Arc<System>>,
    /// States `[trajectory][F + 1][state_dim]`.
    pub states: Vec<f64>,
    /// Noisy sensor readings of the states at the start of each frame, `[trajectory][F][state_dim]`; contacts are
    /// computed from these readings. Empty without sensor noise ([`crate::vary`]).
    pub shown: Vec<f64>,
    /// Joint torques held constant over each frame, `[trajectory][F][joints]`.
    pub torques: Vec<f64>,
    /// Surface normals at the start of each frame, world axes, `[trajectory][F][points][3]`.
    pub normals: Vec<f64>,
    /// Nearest scene points at the start of each frame, world (m), `[trajectory][F][points][3]`.
    pub points: Vec<f64>,
    /// Signed distances at the start of each frame (m), `[trajectory][F][points]`; infinite in an empty scene.
    pub depths: Vec<f64>,
    /// Gravity (m/s^2), `[trajectory][3]`.
    pub gravity: Vec<f64>,
    /// Drawn parameters of the robot, `[trajectory][crate::vary::columns]`; empty without `[vary]`.
    pub drawn: Vec<f64>,
}

/// Equal numbers; scenes and robots are not compared, since shards do not store them.
impl PartialEq for Trajectories {
    fn eq(&self, other: &Self) -> bool {
        self.arrays() == other.arrays()
    }
}

/// Row `row` of an array with `rows` rows.
fn row(x: &[f64], rows: usize, row: usize) -> &[f64] {
    let width = x.len() / rows;
    &x[row * width..][..width]
}

impl Trajectories {
    /// State `[q, qd]` of a trajectory before a frame, or after the last.
    pub fn state(&self, trajectory: usize, frame: usize) -> &[f64] {
        row(&self.states, self.count * (self.frames + 1), trajectory * (self.frames + 1) + frame)
    }

    /// The state at the start of a frame as the sensors show it.
    pub fn seen(&self, trajectory: usize, frame: usize) -> &[f64] {
        match &self.shown[..] {
            [] => self.state(trajectory, frame),
            shown => row(shown, self.count * self.frames, trajectory * self.frames + frame),
        }
    }

    /// Torques of all joints during a frame (N m or N).
    pub fn torques(&self, trajectory: usize, frame: usize) -> &[f64] {
        row(&self.torques, self.count * self.frames, trajectory * self.frames + frame)
    }

    /// States of all trajectories before a frame, `[trajectory][state_dim]`.
    pub fn states_at(&self, frame: usize) -> Vec<f64> {
        (0..self.count).flat_map(|k| self.state(k, frame)).copied().collect()
    }

    /// Torques of all trajectories during a frame, `[trajectory][joint]`.
    pub fn torques_at(&self, frame: usize) -> Vec<f64> {
        (0..self.count).flat_map(|k| self.torques(k, frame)).copied().collect()
    }

    /// A batch with an environment for each trajectory, in its scene and at its first state.
    ///
    /// # Panics
    /// Without scenes.
    pub fn begun(&self, system: &Arc<System>) -> Batch {
        let mut batch = Batch::new(system, &self.scenes[0], self.count);
        (batch.systems, batch.scenes) = (self.systems.clone(), self.scenes.clone());
        batch.states = self.states_at(0);
        batch
    }

    /// The same trajectories without their first frames; sensor readings and contacts are left out.
    #[must_use]
    pub fn after(&self, first: usize) -> Self {
        let rest = |x: &[f64], rows: usize| {
            let each = x.len() / self.count;
            x.chunks(each.max(1)).flat_map(|own| &own[each / rows * first..]).copied().collect()
        };
        let (states, torques) = (rest(&self.states, self.frames + 1), rest(&self.torques, self.frames));
        Self { frames: self.frames - first, states, torques, ..self.clone().bare() }
    }

    /// The same trajectories without sensor readings and contacts.
    #[must_use]
    pub fn bare(self) -> Self {
        let [shown, normals, points, depths] = Default::default();
        Self { shown, normals, points, depths, ..self }
    }

    /// All trajectories of `parts`, which have equally many frames.
    pub fn joined(parts: impl IntoIterator<Item = Self>) -> Self {
        let mut parts = parts.into_iter();
        let mut all = parts.next().unwrap_or_default();
        for mut part in parts {
            all.count += part.count;
            all.scenes.append(&mut part.scenes);
            all.systems.append(&mut part.systems);
            all.numbers().into_iter().zip(part.numbers()).for_each(|(own, more)| own.append(more));
        }
        all
    }

    fn numbers(&mut self) -> [&mut Vec<f64>; 8] {
        let Self { states, shown, torques, normals, points, depths, gravity, drawn, .. } = self;
        [states, shown, torques, normals, points, depths, gravity, drawn]
    }

    /// Computes the contacts at the start of each frame, from the sensor readings.
    pub(crate) fn touch(&mut self, system: &System) {
        let rows = self.count * self.frames * system.robot.contact_points.len();
        if rows == 0 {
            return;
        }
        self.normals.reserve_exact(3 * rows);
        self.points.reserve_exact(3 * rows);
        self.depths.reserve_exact(rows);
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        for (trajectory, frame) in (0..self.count).flat_map(|k| (0..self.frames).map(move |frame| (k, frame))) {
            contacts(system, &self.scenes[trajectory], self.seen(trajectory, frame), &mut data, &mut events);
            for event in &events {
                self.normals.extend(event.normal.iter());
                self.points.extend(event.p1.iter());
                self.depths.push(event.distance);
            }
        }
    }

    /// Arrays by name, with the shape of one trajectory; `drawn` and `shown` only if not empty.
    pub fn arrays(&self) -> Vec<(&'static str, Vec<usize>, &Vec<f64>)> {
        let (n, f) = (self.count, self.frames);
        let width = |x: &Vec<f64>, rows: usize| x.len().checked_div(n * rows).unwrap_or(0);
        let contacts = width(&self.depths, f);
        let mut arrays = vec![
            ("states", vec![f + 1, width(&self.states, f + 1)], &self.states),
            ("torques", vec![f, width(&self.torques, f)], &self.torques),
            ("normals", vec![f, contacts, 3], &self.normals),
            ("points", vec![f, contacts, 3], &self.points),
            ("depths", vec![f, contacts], &self.depths),
            ("gravity", vec![3], &self.gravity),
        ];
        if !self.drawn.is_empty() {
            arrays.push(("drawn", vec![width(&self.drawn, 1)], &self.drawn));
        }
        if !self.shown.is_empty() {
            arrays.push(("shown", vec![f, width(&self.shown, f)], &self.shown));
        }
        arrays
    }

    /// Refuses arrays with lengths that do not fit the robot: the robot may have changed after a file was written.
    pub fn check(&self, system: &System) -> Result<(), String> {
        let robot = &system.robot;
        let (n, f, points) = (self.count, self.frames, robot.contact_points.len());
        let (states, torques, surface) = (n * (f + 1) * robot.state_dim(), n * f * robot.joint_count(), n * f * points);
        let wanted = [states, torques, 3 * surface, 3 * surface, surface, 3 * n];
        let wrong = |name: &str, found: usize, what: &str, wanted: usize| {
            format!("`{name}` has {found} numbers, {what} {wanted}; record the data set again")
        };
        if let Some(((name, _, x), wanted)) = self.arrays().iter().zip(wanted).find(|((_, _, x), n)| x.len() != *n) {
            return Err(wrong(name, x.len(), "the robot needs", wanted));
        }
        let shown = if system.noisy() { n * f * robot.state_dim() } else { 0 };
        if self.shown.len() != shown {
            return Err(wrong("shown", self.shown.len(), "noise of the robot's sensors needs", shown));
        }
        let drawn = n * crate::vary::columns(system).len();
        if self.drawn.len() != drawn {
            return Err(wrong("drawn", self.drawn.len(), "[vary] of the robot draws", drawn));
        }
        Ok(())
    }

    /// SHA-256 over the arrays in order.
    pub fn sha256(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        for (_, _, x) in self.arrays() {
            let bytes: Vec<u8> = x.iter().flat_map(|v| v.to_le_bytes()).collect();
            hash.update(&bytes);
        }
        hash.finalize().into()
    }
}
