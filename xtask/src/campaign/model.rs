//! Folders of models: loaded, and a few frames stepped.

use anyhow::Result;
use nerd_model::folder::{Model, ModelError};
use nerd_model::neural::Neural;
use nerd_sim::prelude::*;
use rand::{Rng, RngExt};
use serde_json::Value;

use super::bench::{Bench, write};
use super::case::{Fault, Files, Verdict};
use super::mutate::{anything, bytes, one, times};

/// Frames stepped: more than a window has.
const FRAMES: usize = 6;

/// A good model, changed.
pub fn make(rng: &mut impl Rng, bench: &Bench) -> Files {
    let mut files = bench.models[rng.random_range(0..2)].clone();
    for _ in 0..times(rng) {
        match rng.random_range(0..20) {
            0..8 => json(rng, files.entry("config.json".into()).or_default()),
            8..12 => json(rng, files.entry("normalizer.json".into()).or_default()),
            12..19 => tensors(rng, files.entry("model.safetensors".into()).or_default()),
            _ => {
                let gone = one(rng, &["config.json", "normalizer.json", "model.safetensors"]);
                files.remove(gone);
            }
        }
    }
    files
}

/// A value becomes another, or goes.
fn json(rng: &mut impl Rng, file: &mut Vec<u8>) {
    let Ok(mut tree) = serde_json::from_slice::<Value>(file) else { return anything(rng, file) };
    if rng.random_range(0..4) == 0 {
        return anything(rng, file);
    }
    let mut at = &mut tree;
    // Down to a leaf, or not quite.
    while rng.random_range(0..12) > 0 {
        let inside = match at {
            Value::Object(map) => map.len(),
            Value::Array(list) => list.len(),
            _ => 0,
        };
        if inside == 0 {
            break;
        }
        let k = rng.random_range(0..inside);
        if rng.random_range(0..30) == 0 {
            match at {
                Value::Object(map) => drop(map.keys().nth(k).cloned().and_then(|key| map.remove(&key))),
                Value::Array(list) => drop(list.remove(k)),
                _ => {}
            }
            *file = tree.to_string().into_bytes();
            return;
        }
        at = match at {
            Value::Object(map) => match map.values_mut().nth(k) {
                Some(value) => value,
                None => return,
            },
            Value::Array(list) => &mut list[k],
            _ => return,
        };
    }
    let odd = [
        "0",
        "1",
        "2",
        "3",
        "5",
        "7",
        "33",
        "64",
        "-1",
        "1000000000",
        "18446744073709551615",
        "1e308",
        "-1e308",
        "1e-308",
        "0.5",
        "null",
        "\"nan\"",
        "[]",
        "{}",
        "true",
        "\"mlp\"",
        "\"gru\"",
        "\"lstm\"",
        "\"rotary\"",
        "\"table\"",
        "\"flight\"",
        "\"exact_flight\"",
        "\"nothing\"",
        "\"world\"",
        "\"blind\"",
        "\"cartpole\"",
    ];
    *at = serde_json::from_str(one(rng, &odd)).unwrap_or(Value::Null);
    *file = tree.to_string().into_bytes();
}

/// A weight, the header, or the length.
fn tensors(rng: &mut impl Rng, file: &mut Vec<u8>) {
    let header = file.first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b) as usize);
    let data = header.saturating_add(8);
    if data >= file.len() {
        return bytes(rng, file);
    }
    match rng.random_range(0..6) {
        0 => bytes(rng, file),
        1 => {
            // A header of another text, and its length with it.
            let mut text = file[8..data].to_vec();
            match rng.random_range(0..2) {
                0 => anything(rng, &mut text),
                _ => json(rng, &mut text),
            }
            let length = (text.len() as u64).to_le_bytes().to_vec();
            *file = [length, text, file[data..].to_vec()].concat();
        }
        2 => file[rng.random_range(0..8)] = rng.random(),
        _ => {
            let at = data + rng.random_range(0..(file.len() - data) / 4) * 4;
            let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, -0.0, 1e-45, 1e20, 1.0, 100.0];
            file[at..at + 4].copy_from_slice(&odd[rng.random_range(0..odd.len())].to_le_bytes());
        }
    }
}

/// Loads it and steps it, on a ground.
pub fn judge(files: &Files, bench: &Bench) -> Result<Verdict> {
    let folder = bench.empty("model")?;
    write(&folder, files)?;
    let system = &bench.system;
    let model = match Model::load(&folder, system, None) {
        Ok(model) => Ok(model),
        // A hash refuses any change, so what comes after it is tried as if somebody had stamped the folder again.
        Err(ModelError::Changed { .. } | ModelError::NoStamp { .. }) => Model::read(&folder, system, None),
        Err(e) => Err(e),
    };
    let model = match model {
        Ok(model) => model,
        Err(e) => return Ok(Verdict::Refused(e.to_string())),
    };
    if let Some(words) = not_finite(&model) {
        return Ok(Verdict::Fault(Fault::NotFinite, words));
    }
    let scene = match system.scene("ground1") {
        Ok(scene) => scene,
        Err(e) => return Ok(Verdict::Refused(e.to_string())),
    };
    let mut batch = Batch::new(system, &scene, 3);
    for env in 0..3 {
        let q = 0.5 * env as f64 - 1.0;
        batch.reset(env, &[q, 0.3, -1.0, 2.0]);
    }
    let mut solver = Neural::on_cpu(model, system);
    let torques = [1.0; 6];
    let done = (0..FRAMES).try_for_each(|_| solver.step(&mut batch, &torques));
    Ok(match done {
        _ if batch.states.iter().any(|x| !x.is_finite()) => Verdict::Fault(Fault::NotFinite, format!("states {:?}", batch.states)),
        Ok(()) => Verdict::Accepted,
        Err(e) => Verdict::Refused(e.to_string()),
    })
}

/// The first number of a model that is none, or no variance.
fn not_finite(model: &Model) -> Option<String> {
    let weight = model.weights.iter().find(|(.., x)| x.iter().any(|w| !w.is_finite())).map(|(name, ..)| format!("tensor `{name}`"));
    let sides = [("inputs", &model.normalizer.inputs), ("outputs", &model.normalizer.outputs)];
    let moment = sides.into_iter().find_map(|(name, moments)| {
        let mean = moments.mean.iter().any(|x| !x.is_finite());
        let variance = moments.variance.iter().any(|x| !(x.is_finite() && *x >= 0.0));
        (mean || variance).then(|| format!("moments of {name}"))
    });
    weight.or(moment)
}
