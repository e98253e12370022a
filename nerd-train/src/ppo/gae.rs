//! Generalised advantage estimation (Schulman et al. 2016), equations 11 to 16, over episodes that end within the horizon.
//!
//! ```text
//! delta_t = r_t + gamma V(s_{t+1}) [not terminated] - V(s_t)
//! A_t = delta_t + gamma lambda A_{t+1} [not ended]
//! ```
//!
//! `V(s_{t+1})` is that of the state reached, also where the episode was cut off by time and another one began (time-out
//! bootstrapping); only a terminal state has none.

/// What happened, `[step][env]`.
pub(super) struct Transitions<'a> {
    /// Rewards.
    pub rewards: &'a [f64],
    /// Values of the states acted in.
    pub values: &'a [f64],
    /// Values of the states reached.
    pub next: &'a [f64],
    /// Whether the episode ended in a terminal state.
    pub terminated: &'a [bool],
    /// Whether it ran out of time.
    pub truncated: &'a [bool],
}

/// Advantages `[step][env]` of n environments; returns are these plus the values.
pub(super) fn advantages(steps: &Transitions, n: usize, gamma: f64, lambda: f64) -> Vec<f64> {
    let mut out = vec![0.0; steps.rewards.len()];
    for i in (0..out.len()).rev() {
        let beyond = if steps.terminated[i] { 0.0 } else { gamma * steps.next[i] };
        let delta = steps.rewards[i] + beyond - steps.values[i];
        let ended = steps.terminated[i] || steps.truncated[i] || i + n >= out.len();
        out[i] = delta + if ended { 0.0 } else { gamma * lambda * out[i + n] };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advantages_end_where_episodes_do() {
        // One environment, four steps: the second is cut off by time, the third is terminal.
        let steps = Transitions {
            rewards: &[1.0, 2.0, 3.0, 4.0],
            values: &[10.0, 20.0, 30.0, 40.0],
            next: &[20.0, 25.0, 99.0, 50.0],
            terminated: &[false, false, true, false],
            truncated: &[false, true, false, false],
        };
        // delta: 1 + 10 - 10, 2 + 12.5 - 20 (the value reached, not that of the next start), 3 - 30, 4 + 25 - 40.
        assert_eq!(advantages(&steps, 1, 0.5, 0.5), [1.0 + 0.25 * -5.5, -5.5, -27.0, -11.0]);
    }
}
