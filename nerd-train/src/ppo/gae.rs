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
pub struct Steps<'a> {
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
pub fn advantages(steps: &Steps, n: usize, gamma: f64, lambda: f64) -> Vec<f64> {
    let mut out = vec![0.0; steps.rewards.len()];
    for i in (0..out.len()).rev() {
        let beyond = if steps.terminated[i] { 0.0 } else { gamma * steps.next[i] };
        let delta = steps.rewards[i] + beyond - steps.values[i];
        let ended = steps.terminated[i] || steps.truncated[i] || i + n >= out.len();
        out[i] = delta + if ended { 0.0 } else { gamma * lambda * out[i + n] };
    }
    out
}
