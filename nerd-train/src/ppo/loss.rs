//! PPO loss of one step and its gradient with respect to the network's outputs (Schulman et al. 2017). Its terms are
//! those of rl_games.
//!
//! Let p be the ratio of new to old action probability, A the advantage and eps the clip range. The normalised value
//! and return are v and R; the mean action and its log standard deviation are mu and s.
//!
//! ```text
//! L = max(-A p, -A clamp(p, 1 - eps, 1 + eps))
//!   + CRITIC / 2 max((v - R)^2, (v_old + clamp(v - v_old, -value eps, value eps) - R)^2)
//!   + bounds sum (max(mu - 1.1, 0)^2 + min(mu + 1.1, 0)^2) - entropy sum (s + 1/2 ln 2 pi e)
//! ```

use super::*;

/// Bound (absolute value) of mean actions; beyond it the bounds loss applies.
const BOUND: f32 = 1.1;
/// Weight of the value loss.
pub(super) const CRITIC: f32 = 4.0;
const HALF_LN_TAU: f32 = 0.918_938_5;

/// Data of a step recorded in the rollout.
#[derive(Clone, Copy)]
pub(super) struct Past<'a> {
    pub action: &'a [f32],
    /// Negative log-probability of the action under the rollout's policy.
    pub neg_log_prob: f32,
    pub advantage: f32,
    pub value_target: f32,
    /// Normalised value predicted in the rollout.
    pub value: f32,
}

/// Loss terms: sums over steps, or means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Terms {
    /// Clipped policy objective, negated.
    #[serde(rename = "actor_loss", deserialize_with = "figure")]
    pub actor: f64,
    /// Squared error of the normalised value.
    #[serde(rename = "critic_loss", deserialize_with = "figure")]
    pub critic: f64,
    /// Squared excess of mean actions over their bounds, unweighted.
    #[serde(rename = "bounds_loss", deserialize_with = "figure")]
    pub bounds: f64,
    /// Entropy of the policy (nats).
    #[serde(deserialize_with = "figure")]
    pub entropy: f64,
    /// KL divergence `KL(new, old)`, where old is the policy one pass earlier.
    #[serde(deserialize_with = "figure")]
    pub kl: f64,
    /// Steps with a probability ratio outside the clip range.
    #[serde(deserialize_with = "figure")]
    pub clipped: f64,
}

/// Reads a number, or `null` as NaN: JSON has no non-finite numbers.
pub(super) fn figure<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
}

impl Terms {
    /// Terms by name.
    pub(super) fn named(&self) -> [(&'static str, f64); 6] {
        let Self { actor, critic, bounds, entropy, kl, clipped } = *self;
        [
            ("actor_loss", actor),
            ("critic_loss", critic),
            ("bounds_loss", bounds),
            ("entropy", entropy),
            ("kl", kl),
            ("clipped", clipped),
        ]
    }

    pub(super) fn of([actor, critic, bounds, entropy, kl, clipped]: [f64; 6]) -> Self {
        Self { actor, critic, bounds, entropy, kl, clipped }
    }

    pub(super) fn add(&mut self, other: &Self) {
        let (mine, theirs) = (self.named(), other.named());
        *self = Self::of(std::array::from_fn(|k| mine[k].1 + theirs[k].1));
    }

    pub(super) fn over(&self, n: f64) -> Self {
        Self::of(self.named().map(|(_, x)| x / n))
    }
}

/// `-ln N(action; mu, exp(s)^2)`.
pub(super) fn neg_log_prob(action: &[f32], mu: &[f32], s: &[f32]) -> f32 {
    izip!(action, mu, s).map(|(a, mu, s)| 0.5 * ((a - mu) * (-s).exp()).powi(2) + s + HALF_LN_TAU).sum()
}

/// `KL(N(mu, exp(s)^2), N(mu_old, exp(s_old)^2))`.
pub(super) fn divergence(mu: &[f32], s: &[f32], old_mu: &[f32], old_s: &[f32]) -> f32 {
    let all = izip!(mu, s, old_mu, old_s);
    all.map(|(mu, s, old_mu, old_s)| {
        let ratio = 2.0 * (s - old_s);
        let far = (mu - old_mu) * (-old_s).exp();
        0.5 * (ratio.exp() + far * far - 1.0 - ratio)
    })
    .sum()
}

/// Loss terms of one step. Writes the gradients of `scale` times the loss with respect to mean action, log standard
/// deviation and value.
pub(super) fn step(
    config: &PpoConfig,
    past: Past,
    (mu, s, v): (&[f32], &[f32], f32),
    scale: f32,
    (d_mu, d_s, d_v): (&mut [f32], &mut [f32], &mut f32),
) -> Terms {
    let Past { action, advantage, value_target, .. } = past;
    let ratio = (past.neg_log_prob - neg_log_prob(action, mu, s)).exp();
    let (low, high) = (1.0 - config.clip_coef, 1.0 + config.clip_coef);
    let free = -advantage * ratio;
    let held = -advantage * ratio.clamp(low, high);
    // Gradient of the policy loss with respect to ln p: zero where the clipped term is larger.
    let by_log = if free >= held { -advantage * ratio } else { 0.0 };
    let mut terms = Terms { actor: f64::from(free.max(held)), ..Default::default() };
    terms.clipped = f64::from(u8::from(!(low..=high).contains(&ratio)));
    for k in 0..mu.len() {
        let z = (action[k] - mu[k]) * (-s[k]).exp();
        let beyond = (mu[k] - BOUND).max(0.0) + (mu[k] + BOUND).min(0.0);
        terms.bounds += f64::from(beyond * beyond);
        terms.entropy += f64::from(s[k] + HALF_LN_TAU + 0.5);
        d_mu[k] = scale * (by_log * z * (-s[k]).exp() + 2.0 * config.bounds_coef * beyond);
        d_s[k] = scale * (by_log * (z * z - 1.0) - config.ent_coef);
    }
    let most = if config.value_clip > 0.0 { config.value_clip } else { f32::INFINITY };
    let moved = v - past.value;
    let near = past.value + moved.clamp(-most, most);
    let (plain, kept) = ((v - value_target).powi(2), (near - value_target).powi(2));
    terms.critic = f64::from(plain.max(kept));
    let inside = if moved.abs() < most { 1.0 } else { 0.0 };
    *d_v = scale * CRITIC * if plain >= kept { v - value_target } else { inside * (near - value_target) };
    terms
}
