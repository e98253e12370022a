//! How far motions are apart. An error is the mean of |dp| and of the angle between the orientations over all samples of a
//! rollout, then over rollouts.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::protocol::{Motion, Trial};

/// Distance of two sets of motions.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Score {
    /// Mean |dp| (m).
    pub position: f64,
    /// Mean angle (rad).
    pub rotation: f64,
    /// Standard deviation of |dp| over rollouts.
    pub position_spread: f64,
    /// Standard deviation of the angle over rollouts.
    pub rotation_spread: f64,
    /// Median of |dp| over rollouts.
    pub position_median: f64,
    /// Median of the angle over rollouts.
    pub rotation_median: f64,
    /// Share of rollouts that end on another face.
    pub other_face: f64,
    /// Their share of all the angles.
    pub other_face_angles: f64,
    /// Both means by sample, of motions of equal length.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_step: Vec<[f64; 2]>,
}

impl Score {
    /// Without the figures by step.
    pub fn brief(self) -> Self {
        Self { by_step: Vec::new(), ..self }
    }
}

/// The distance of each motion from its like; of none, zeros.
pub fn score<'a>(pairs: impl Iterator<Item = (&'a Motion, &'a Motion)>) -> Score {
    let (mut each, mut steps, mut equal) = (Vec::new(), Vec::<[f64; 2]>::new(), true);
    let (mut others, mut angles) = (0.0, 0.0);
    for (a, b) in pairs {
        let gaps: Vec<[f64; 2]> = a.iter().zip(b).map(|(a, b)| gap(a, b)).collect();
        equal &= each.is_empty() || steps.len() == gaps.len();
        steps.resize(gaps.len().max(steps.len()), [0.0; 2]);
        for (sum, gap) in steps.iter_mut().zip(&gaps) {
            (sum[0], sum[1]) = (sum[0] + gap[0], sum[1] + gap[1]);
        }
        let means = [0, 1].map(|k| gaps.iter().map(|g| g[k]).sum::<f64>() / gaps.len() as f64);
        if a.last().map(top) != b.last().map(top) {
            (others, angles) = (others + 1.0, angles + means[1]);
        }
        each.push(means);
    }
    if each.is_empty() {
        return Score::default();
    }
    let n = each.len() as f64;
    let [(position, position_spread, position_median), (rotation, rotation_spread, rotation_median)] = [0, 1].map(|k| {
        let mean = each.iter().map(|e| e[k]).sum::<f64>() / n;
        let spread = (each.iter().map(|e| (e[k] - mean).powi(2)).sum::<f64>() / n).sqrt();
        each.sort_by(|a, b| a[k].total_cmp(&b[k]));
        (mean, spread, each[each.len() / 2][k])
    });
    Score {
        position,
        rotation,
        position_spread,
        rotation_spread,
        position_median,
        rotation_median,
        other_face: others / n,
        other_face_angles: angles / (n * rotation).max(f64::MIN_POSITIVE),
        by_step: if equal { steps.iter().map(|s| s.map(|x| x / n)).collect() } else { Vec::new() },
    }
}

/// The body axis, and its side, nearest to up.
fn top(pose: &Isometry3<f64>) -> (usize, bool) {
    let up = pose.rotation.inverse() * Vector3::z();
    (up.iamax(), up[up.iamax()] > 0.0)
}

fn gap(a: &Isometry3<f64>, b: &Isometry3<f64>) -> [f64; 2] {
    [(a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation)]
}

/// The distance of `motions` from what was measured.
pub fn against(trials: &[Trial], motions: &[Motion]) -> Score {
    score(motions.iter().zip(trials.iter().map(|t| &t.measured)))
}
