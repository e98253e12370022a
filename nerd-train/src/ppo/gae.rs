//! Generalised advantage estimation (GAE, Schulman et al. 2016), equations 11 to 16, over episodes that end within the
//! horizon.
//!
//! ```text
//! delta_t = r_t + gamma V(s_{t+1}) [not terminated] - V(s_t)
//! A_t = delta_t + gamma lambda A_{t+1} [not ended]
//! ```
//!
//! `V(s_{t+1})` is the value of the state reached by the step. A truncated episode bootstraps from its final state;
//! only a terminal state has value 0.

use super::PpoConfig;

/// Lambda of GAE.
pub(super) const LAMBDA: f64 = 0.95;
/// The step ended its episode in a terminal state.
pub const TERMINATED: u8 = 1;
/// The step was the last of its episode because time ran out.
pub const TRUNCATED: u8 = 2;

/// Advantages `[step][env]`; returns are advantages plus `values`. `values` belong to the states before each step,
/// `last` `[env]` to the states after the last step. `cut` holds the values of the final states of truncated episodes,
/// in order of step and environment.
pub(super) fn advantages(
    (rewards, ends): (&[f64], &[u8]),
    (values, last, cut): (&[f64], &[f64], &[f64]),
    config: &PpoConfig,
) -> Vec<f64> {
    let n = last.len();
    let mut cut = cut.iter().rev();
    let PpoConfig { gamma, .. } = config;
    let mut out = vec![0.0; rewards.len()];
    for i in (0..out.len()).rev() {
        let later = (i + n).checked_sub(out.len());
        let mut next = later.map_or_else(|| values[i + n], |env| last[env]);
        if ends[i] == TRUNCATED {
            next = cut.next().copied().unwrap_or(next);
        }
        let beyond = if ends[i] == TERMINATED { 0.0 } else { gamma * next };
        let delta = rewards[i] + beyond - values[i];
        out[i] = delta + if ends[i] > 0 || later.is_some() { 0.0 } else { gamma * LAMBDA * out[i + n] };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advantages_end_where_episodes_do() {
        // One environment, four steps: the second truncates the episode, the third terminates it.
        let came = (&[1.0, 2.0, 3.0, 4.0][..], &[0, TRUNCATED, TERMINATED, 0][..]);
        let config = PpoConfig { gamma: 0.5, ..PpoConfig::default() };
        let found = advantages(came, (&[10.0, 20.0, 30.0, 40.0], &[50.0], &[25.0]), &config);
        // delta: 1 + 10 - 10, 2 + 12.5 - 20 (bootstrap from the final state, not the next start), 3 - 30, 4 + 25 - 40.
        assert_eq!(found, [1.0 + 0.5 * LAMBDA * -5.5, -5.5, -27.0, -11.0]);
    }
}
