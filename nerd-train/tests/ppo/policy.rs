//! Policies against the textbook in f64: outputs of shipped policies, gradients of the loss; their folders and
//! settings.

use nerd_tasks::names;
use nerd_train::ppo::folder::{PolicyConfig, load, save};
use rand::RngExt;

use crate::*;

#[test]
fn gradients_are_those_of_the_loss_written_down_in_f64() {
    let mut worst: f64 = 0.0;
    for (activation, state_dependent_std, value_clip) in
        [(Activation::Tanh, false, 0.2), (Activation::Elu, true, 0.2), (Activation::Tanh, false, 0.0)]
    {
        let shape = Shape { observation: 3, stack: 1, action: 2, hidden: vec![5, 4], activation, state_dependent_std };
        let mut rng = stream(3, 0);
        let mut draw = move || f64::from(rng.random::<f32>()) * 2.0 - 1.0;
        let mut policy = Policy::new(shape, &mut stream(1, 1));
        policy.flat.iter_mut().for_each(|w| *w += 0.3 * draw() as f32);
        let n = 40;
        let mut numbers = |n: usize, scale: f64| (0..n).map(|_| scale * draw()).collect::<Vec<f64>>();
        let f32s = |x: Vec<f64>| x.into_iter().map(|x| x as f32).collect::<Vec<f32>>();
        let rollout = Rollout {
            observations: numbers(n * 3, 2.0),
            actions: f32s(numbers(n * 2, 2.0)),
            mean: f32s(numbers(n * 2, 0.5)),
            spread: f32s(numbers(n * 2, 0.2)),
            // Near the policy's own values, so that some ratios are clipped and some are not.
            neg_log_prob: f32s(numbers(n, 1.0).into_iter().map(|x| 3.0 + x).collect()),
            values: numbers(n, 0.4),
            advantages: numbers(n, 1.0),
        };
        // One minibatch of all steps: ten times Adam's first moment is the gradient, scaled to a norm of at most 1.
        let config = PpoConfig {
            environments: n,
            horizon: 1,
            minibatch: n,
            epochs: 1,
            ent_coef: 0.02,
            bounds_coef: 0.3,
            value_clip,
            ..PpoConfig::default()
        };
        let (mut engine, mut learned, mut adam) =
            (OnCpu::default(), policy.clone(), Adam::new(policy.flat.len(), 1e-3));
        engine.rollout = rollout.clone();
        let updated =
            engine.update(&mut learned, &mut adam, &config, StreamKey { seed: 0, number: 0 }).expect("the CPU");
        let scale = 10.0 * updated.gradient_norm.max(1.0) as f32;
        let found: Vec<f32> = adam.m.iter().map(|m| scale * m).collect();
        let params: Vec<f64> = policy.flat.iter().map(|w| f64::from(*w)).collect();
        for k in 0..params.len() {
            let at = |h: f64| {
                let mut moved = params.clone();
                moved[k] += h;
                loss(&moved, &policy, &learned.returns, &rollout, &config)
            };
            let by_difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            let gap = (f64::from(found[k]) - by_difference).abs() / (1.0 + by_difference.abs());
            worst = worst.max(gap);
            assert!(gap < 2e-5, "{activation:?}, parameter {k}: {} against {by_difference} by differences", found[k]);
        }
    }
    println!("worst gap {worst:.1e}");
}

/// Outputs of a policy with these parameters for an observation, by the textbook.
fn said(flat: &[f64], policy: &Policy, observation: &[f64]) -> Vec<f64> {
    let (sizes, mut at) = (policy.shape.widths(), 0);
    let mut x: Vec<f64> = observation.iter().enumerate().map(|(k, x)| policy.seen.normalize(k, *x)).collect();
    for (l, w) in sizes.windows(2).enumerate() {
        let bias = at + w[0] * w[1];
        let y = (0..w[1]).map(|j| flat[bias + j] + (0..w[0]).map(|k| x[k] * flat[at + k * w[1] + j]).sum::<f64>());
        let f = |y: f64| match policy.shape.activation {
            _ if l + 2 == sizes.len() => y,
            Activation::Tanh => y.tanh(),
            Activation::Relu => y.max(0.0),
            Activation::Elu => y.max(0.0) + y.min(0.0).exp_m1(),
            Activation::Gelu => unreachable!("no policy here has GELU"),
        };
        x = y.map(f).collect();
        at = bias + w[1];
    }
    x
}

#[test]
fn shipped_policies_say_what_their_weights_say_in_f64() {
    let all = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/policies")).expect("shipped policies");
    let (mut worst, mut count) = (0.0f64, 0);
    for path in all.map(|entry| entry.expect("a folder").path()).filter(|path| path.join("config.json").exists()) {
        let (_, policy) = load(&path).expect("a policy");
        let (flat, a) = (policy.flat.iter().map(|w| f64::from(*w)).collect::<Vec<f64>>(), policy.shape.action);
        // Within two standard deviations of the observations seen.
        let (seen, width) = (&policy.seen, policy.shape.inputs());
        let number = |i: usize| seen.mean[i % width] + 2.0 * seen.variance[i % width].sqrt() * (i as f64 * 1.7).sin();
        let rows: Vec<f64> = (0..7 * width).map(number).collect();
        let answer = policy.answer(&rows);
        for (i, row) in rows.chunks(width).enumerate() {
            let expected = said(&flat, &policy, row);
            let found = answer.mean[i * a..(i + 1) * a].iter().chain([&answer.value[i]]);
            for off in found.zip(&expected).map(|(x, y)| (f64::from(*x) - y).abs() / (1.0 + y.abs())) {
                assert!(off < 1e-5, "{}: off by {off:.1e}", path.display());
                worst = worst.max(off);
            }
        }
        count += 1;
    }
    println!("{count} policies, off by {worst:.1e} at most");
    assert!(count > 0, "no policies are shipped");
}

/// The loss of `loss.rs`, written without a thought for speed; `moments` include the rollout's returns.
fn loss(flat: &[f64], policy: &Policy, moments: &RunningMoments, r: &Rollout, c: &PpoConfig) -> f64 {
    let shape = &policy.shape;
    let mean = r.advantages.iter().sum::<f64>() / r.advantages.len() as f64;
    let spread = (r.advantages.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / r.advantages.len() as f64).sqrt();
    let mut total = 0.0;
    for i in 0..r.values.len() {
        let x = said(flat, policy, &r.observations[3 * i..3 * i + 3]);
        let free = flat.len() - 2;
        let s: Vec<f64> = (0..2).map(|k| if shape.state_dependent_std { x[3 + k] } else { flat[free + k] }).collect();
        let half_ln_tau = 0.5 * std::f64::consts::TAU.ln();
        let (mut neg_log_prob, mut others) = (0.0, 0.0);
        for k in 0..2 {
            let a = f64::from(r.actions[2 * i + k]);
            neg_log_prob += 0.5 * ((a - x[k]) / s[k].exp()).powi(2) + s[k] + half_ln_tau;
            others += f64::from(c.bounds_coef) * ((x[k] - 1.1).max(0.0).powi(2) + (x[k] + 1.1).min(0.0).powi(2));
            others -= f64::from(c.ent_coef) * (s[k] + half_ln_tau + 0.5);
        }
        let ratio = (f64::from(r.neg_log_prob[i]) - neg_log_prob).exp();
        let advantage = (r.advantages[i] - mean) / spread;
        let actor = (-advantage * ratio).max(-advantage * ratio.clamp(0.8, 1.2));
        let (v, value_target, old) =
            (x[2], moments.normalize(0, r.advantages[i] + r.values[i]), policy.returns.normalize(0, r.values[i]));
        let near = old + (v - old).clamp(-0.2, 0.2);
        let held = if c.value_clip > 0.0 { (near - value_target).powi(2) } else { 0.0 };
        total += actor + 2.0 * (v - value_target).powi(2).max(held) + others;
    }
    total / r.values.len() as f64
}

#[test]
fn every_task_has_settings_and_a_policy_survives_its_folder() {
    let temporary = tempfile::tempdir().expect("temporary folder");
    let folder = temporary.path();
    for name in names() {
        let (task, ppo) = (named(name).expect("registered"), PpoConfig::of(name).expect("settings"));
        PpoConfig::small(name).expect("small settings");
        let shape = Shape::of(&*task, &ppo);
        let mut policy = Policy::new(shape.clone(), &mut stream(0, 0));
        policy.seen.update(&(0..shape.inputs() * 3).map(|k| k as f64).collect::<Vec<_>>());
        let (solver, provenance) = (Truth::default().name(), Default::default());
        let config = PolicyConfig { task: name.into(), solver, shape, ppo, iterations: 1, reward: None, provenance };
        save(folder, &config, &policy, "# A card\n").expect("written");
        let (mut found, weights) = load(folder).expect("read");
        assert_eq!(found.provenance.remove("weights sha256"), Some(policy.sha256()), "{name}");
        assert_eq!((found, weights), (config.clone(), policy.clone()), "{name}");
        let refused = |change: fn(&mut Policy)| {
            let mut policy = policy.clone();
            change(&mut policy);
            save(folder, &config, &policy, "# A card\n").expect("written");
            load(folder).expect_err("cannot be").to_string()
        };
        for said in [refused(|p| p.flat[1] = f32::NAN), refused(|p| p.seen.variance[0] = -1.0)] {
            assert!(said.contains("not a finite number, or a variance is below 0"), "{name}: {said}");
        }
        let mut wide = config.clone();
        wide.shape.hidden = vec![usize::MAX, usize::MAX];
        std::fs::write(folder.join("config.json"), serde_json::to_string(&wide).expect("JSON")).expect("written");
        let said = load(folder).expect_err("cannot be").to_string();
        assert!(said.contains("hidden is 1.8446744073709552e19"), "{name}: {said}");
    }
    // Weights of another policy of the same task, and of a policy of another task.
    let [own, other] = [(); 2].map(|()| tempfile::tempdir().expect("temporary folder"));
    let weights = |of: &Path| {
        std::fs::copy(of.join("policy.safetensors"), own.path().join("policy.safetensors")).expect("copied")
    };
    let shipped = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/policies").join(name);
    for (folder, name) in [(own.path(), "ant-run-neural-200"), (other.path(), "ant-run-neural-911")] {
        let (config, policy) = load(&shipped(name)).expect("shipped");
        save(folder, &config, &policy, "# A card\n").expect("written");
    }
    assert!(load(own.path()).is_ok());
    weights(other.path());
    let said = load(own.path()).expect_err("other weights").to_string();
    assert!(said.contains("policy.safetensors: its weights are not those that config.json has the hash of"), "{said}");
    // An older file of weights names its task alone.
    weights(&shipped("ant-spin-neural-200"));
    std::fs::copy(shipped("ant-run-neural-200").join("config.json"), own.path().join("config.json")).expect("copied");
    let said = load(own.path()).expect_err("another task").to_string();
    assert!(said.contains("it is of task `ant-spin`, and config.json of `ant-run`"), "{said}");
    for (text, key) in [
        ("environments = 1\nhurry = true", "hurry"),
        ("environments = 0", "environments"),
        ("learning_rate = nan", "learning_rate"),
    ] {
        let said = PpoConfig::from_text(text).expect_err(text).to_string();
        assert!(said.contains(key), "{text}: {said}");
    }
    let old = "rate = 2e-3\nkl = 0.5\nclip = 0.3\nentropy = 0.1\nbounds = 0.2\nspread = 0.5\n";
    let new = "learning_rate = 2e-3\ntarget_kl = 0.5\nclip_coef = 0.3\nent_coef = 0.1\nbounds_coef = 0.2\ninit_noise_std = 0.5\n";
    assert_eq!(PpoConfig::from_text(old).expect("old keys"), PpoConfig::from_text(new).expect("new keys"));
    let said = PpoConfig::from_text("kl = 0.1\ntarget_kl = 0.1").expect_err("twice").to_string();
    assert!(said.contains("`kl` is the old name of `target_kl`, and both are given"), "{said}");
    let config = own.path().join("config.json");
    let text = std::fs::read_to_string(&config).expect("read");
    let before = text
        .replace("vf_coef", "critic")
        .replace("learning_rate", "rate")
        .replace("state_dependent_std", "spread_by_state");
    let [(new, _), (old, _)] = [&text, &before].map(|text| {
        std::fs::write(&config, text).expect("written");
        weights(&shipped("ant-run-neural-200"));
        load(own.path()).expect("a policy")
    });
    assert!(text != before && new == old);
    assert!(PpoConfig::of("juggle").is_err() && PpoConfig::small("cartpole-juggle").is_err());
}
