//! The loss of one step and its gradient by the network's outputs (Schulman et al. 2017; the terms of rl_games).
//!
//! With p the new over the old probability of the action, A the advantage, v and R normalised value and return, eps the clip:
//!
//! ```text
//! L = max(-A p, -A clamp(p, 1 - eps, 1 + eps))
//!   + critic / 2 max((v - R)^2, (v_old + clamp(v - v_old, -value eps, value eps) - R)^2)
//!   + bounds sum (max(mu - 1.1, 0)^2 + min(mu + 1.1, 0)^2) - entropy sum (s + 1/2 ln 2 pi e)
//! ```

use super::*;

/// Mean actions beyond this cost.
const BOUND: f32 = 1.1;
const HALF_LN_TAU: f32 = 0.918_938_5;

/// What is known of a step from its rollout.
#[derive(Clone, Copy)]
pub(super) struct Past<'a> {
    pub action: &'a [f32],
    /// Minus the logarithm of its probability then.
    pub surprise: f32,
    pub advantage: f32,
    pub goal: f32,
    /// Normalised value then.
    pub value: f32,
}

/// Terms of the loss: sums over steps, or means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Terms {
    /// Of the policy.
    #[serde(rename = "actor_loss", deserialize_with = "figure")]
    pub actor: f64,
    /// Squared error of the normalised value.
    #[serde(rename = "critic_loss", deserialize_with = "figure")]
    pub critic: f64,
    /// Of mean actions out of bounds, without its weight.
    #[serde(rename = "bounds_loss", deserialize_with = "figure")]
    pub bounds: f64,
    /// Entropy of the policy (nats).
    #[serde(deserialize_with = "figure")]
    pub entropy: f64,
    /// Divergence `KL(new, old)` from the policy that was compared with: that of a pass.
    #[serde(deserialize_with = "figure")]
    pub kl: f64,
    /// Steps whose ratio was clipped.
    #[serde(deserialize_with = "figure")]
    pub clipped: f64,
}

/// JSON has no number that is not finite, and writes null.
pub(super) fn figure<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
}

impl Terms {
    /// Its numbers by name.
    pub(super) fn named(&self) -> [(&'static str, f64); 6] {
        let Self { actor, critic, bounds, entropy, kl, clipped } = *self;
        [("actor_loss", actor), ("critic_loss", critic), ("bounds_loss", bounds), ("entropy", entropy), ("kl", kl), ("clipped", clipped)]
    }

    pub(super) fn of([actor, critic, bounds, entropy, kl, clipped]: [f64; 6]) -> Self {
        Self { actor, critic, bounds, entropy, kl, clipped }
    }

    pub(super) fn list(&self) -> [f64; 6] {
        [self.actor, self.critic, self.bounds, self.entropy, self.kl, self.clipped]
    }

    pub(super) fn add(&mut self, other: &Self) {
        let (mine, theirs) = (self.list(), other.list());
        *self = Self::of(std::array::from_fn(|k| mine[k] + theirs[k]));
    }

    pub(super) fn over(&self, n: f64) -> Self {
        Self::of(self.list().map(|x| x / n))
    }
}

/// `-ln N(action; mu, exp(s)^2)`.
pub(super) fn surprise(action: &[f32], mu: &[f32], s: &[f32]) -> f32 {
    action.iter().zip(mu).zip(s).map(|((a, mu), s)| 0.5 * ((a - mu) * (-s).exp()).powi(2) + s + HALF_LN_TAU).sum()
}

/// `KL(N(mu, exp(s)^2), N(mu_old, exp(s_old)^2))`.
pub(super) fn divergence(mu: &[f32], s: &[f32], old_mu: &[f32], old_s: &[f32]) -> f32 {
    let all = mu.iter().zip(s).zip(old_mu.iter().zip(old_s));
    all.map(|((mu, s), (old_mu, old_s))| {
        let (ratio, far) = (2.0 * (s - old_s), (mu - old_mu) * (-old_s).exp());
        0.5 * (ratio.exp() + far * far - 1.0 - ratio)
    })
    .sum()
}

/// Loss terms of one step; writes the gradients of `scale` times the loss by mean, value and spread.
pub(super) fn step(
    config: &PpoConfig,
    past: Past,
    (mu, s, v): (&[f32], &[f32], f32),
    scale: f32,
    (d_mu, d_s, d_v): (&mut [f32], &mut [f32], &mut f32),
) -> Terms {
    let Past { action, advantage, goal, .. } = past;
    let ratio = (past.surprise - surprise(action, mu, s)).exp();
    let (low, high) = (1.0 - config.clip, 1.0 + config.clip);
    let (free, held) = (-advantage * ratio, -advantage * ratio.clamp(low, high));
    // By ln p; where the clipped term is the larger one nothing of it moves.
    let by_log = if free >= held { -advantage * ratio } else { 0.0 };
    let mut terms = Terms { actor: f64::from(free.max(held)), ..Default::default() };
    terms.clipped = f64::from(u8::from(!(low..=high).contains(&ratio)));
    for k in 0..mu.len() {
        let z = (action[k] - mu[k]) * (-s[k]).exp();
        let beyond = (mu[k] - BOUND).max(0.0) + (mu[k] + BOUND).min(0.0);
        terms.bounds += f64::from(beyond * beyond);
        terms.entropy += f64::from(s[k] + HALF_LN_TAU + 0.5);
        d_mu[k] = scale * (by_log * z * (-s[k]).exp() + 2.0 * config.bounds * beyond);
        d_s[k] = scale * (by_log * (z * z - 1.0) - config.entropy);
    }
    let most = if config.value_clip > 0.0 { config.value_clip } else { f32::INFINITY };
    let moved = v - past.value;
    let near = past.value + moved.clamp(-most, most);
    let (plain, kept) = ((v - goal).powi(2), (near - goal).powi(2));
    terms.critic = f64::from(plain.max(kept));
    let inside = if moved.abs() < most { 1.0 } else { 0.0 };
    *d_v = scale * config.critic * if plain >= kept { v - goal } else { inside * (near - goal) };
    terms
}
