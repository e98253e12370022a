//! Folders of models: loaded, and a few frames stepped.

use std::io;
use std::path::Path;
use std::sync::Arc;

use nerd_model::folder::{Model, ModelError};
use nerd_model::neural::Neural;
use nerd_model::normalizer::Moments;
use nerd_sim::prelude::*;
use rand::{Rng, RngExt};
use serde_json::Value;

use crate::campaign::bench::{Bench, write};
use crate::campaign::case::{Fault, Files, Judged, fault};
use crate::campaign::mutate::{anything, bytes, one, pick, times};

/// Frames stepped: more than a window has.
const FRAMES: usize = 6;

/// JSON that no setting wants, and some that another does.
const VALUES: &str = r#"0 1 2 3 5 7 33 64 -1 1000000000 18446744073709551615 1e308 -1e308 1e-308 0.5 null "nan" [] {} true
    "mlp" "gru" "lstm" "rotary" "table" "flight" "exact_flight" "nothing" "world" "blind" "cartpole""#;

/// A good model, changed.
pub fn make(rng: &mut impl Rng, bench: &Bench) -> Files {
    let mut files = bench.models[rng.random_range(0..2)].clone();
    for _ in 0..times(rng) {
        match rng.random_range(0..20) {
            0..8 => json(rng, files.entry("config.json".into()).or_default()),
            8..12 => json(rng, files.entry("normalizer.json".into()).or_default()),
            12..19 => tensors(rng, files.entry("model.safetensors".into()).or_default()),
            _ => drop(files.remove(pick(rng, "config.json normalizer.json model.safetensors"))),
        }
    }
    files
}

/// A value becomes another, or goes.
fn json(rng: &mut impl Rng, file: &mut Vec<u8>) {
    match tree(file).filter(|_| rng.random_range(0..4) > 0) {
        Some(mut tree) => {
            spoil(rng, &mut tree);
            *file = tree.to_string().into_bytes();
        }
        None => anything(rng, file),
    }
}

/// Down to a leaf, or not quite.
fn spoil(rng: &mut impl Rng, at: &mut Value) {
    let mut inside: Vec<&mut Value> = match at {
        Value::Object(map) => map.values_mut().collect(),
        Value::Array(list) => list.iter_mut().collect(),
        _ => Vec::new(),
    };
    if inside.is_empty() || rng.random_range(0..12) == 0 {
        *at = serde_json::from_str(pick(rng, VALUES)).unwrap_or(Value::Null);
        return;
    }
    let k = rng.random_range(0..inside.len());
    if rng.random_range(0..30) > 0 {
        return spoil(rng, inside.swap_remove(k));
    }
    match at {
        Value::Object(map) => drop(map.keys().nth(k).cloned().and_then(|key| map.remove(&key))),
        Value::Array(list) => drop(list.remove(k)),
        _ => {}
    }
}

/// JSON, if it is any.
pub fn tree(bytes: &[u8]) -> Option<Value> {
    serde_json::from_slice(bytes).ok()
}

/// Header of a safetensors file, and where its data begin.
pub fn split(file: &[u8]) -> Option<(&[u8], usize)> {
    let data = (u64::from_le_bytes(*file.first_chunk()?) as usize).checked_add(8)?;
    Some((file.get(8..data)?, data))
}

/// A weight, the header, or the length.
fn tensors(rng: &mut impl Rng, file: &mut Vec<u8>) {
    let Some((header, data)) = split(file).filter(|(_, data)| data + 4 <= file.len()) else { return bytes(rng, file) };
    match rng.random_range(0..6) {
        0 => bytes(rng, file),
        1 => {
            // A header of another text, and its length with it.
            let mut text = header.to_vec();
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
            file[at..at + 4].copy_from_slice(&one(rng, &odd).to_le_bytes());
        }
    }
}

/// Loads it and steps it, on a ground.
pub fn judge(files: &Files, bench: &Bench) -> io::Result<Judged> {
    let folder = bench.empty("model")?;
    write(&folder, files)?;
    Ok(stepped(&folder, &bench.system))
}

fn stepped(folder: &Path, system: &Arc<System>) -> Judged {
    let model = match Model::load(folder, system, None) {
        // A hash refuses any change, so what comes after it is tried as if somebody had stamped the folder again.
        Err(ModelError::Changed { .. } | ModelError::NoStamp { .. }) => Model::read(folder, system, None)?,
        model => model?,
    };
    finite(&model)?;
    let scene = system.scene("ground1")?;
    let mut batch = Batch::new(system, &scene, 3);
    (0..3).for_each(|env| batch.reset(env, &[0.5 * env as f64 - 1.0, 0.3, -1.0, 2.0]));
    let mut solver = Neural::on_cpu(model, system);
    let done = (0..FRAMES).try_for_each(|_| solver.step(&mut batch, &[1.0; 6]));
    if batch.states.iter().any(|x| !x.is_finite()) {
        return fault(Fault::NotFinite, format!("states {:?}", batch.states));
    }
    Ok(done?)
}

/// Refuses the first number of a model that is none, and a variance below zero.
fn finite(model: &Model) -> Judged {
    if let Some((name, ..)) = model.weights.iter().find(|(.., x)| x.iter().any(|w| !w.is_finite())) {
        return fault(Fault::NotFinite, format!("tensor `{name}`"));
    }
    let mut moments = [&model.normalizer.inputs, &model.normalizer.outputs].into_iter();
    let good = |m: &Moments| m.mean.iter().all(|x| x.is_finite()) && m.variance.iter().all(|x| x.is_finite() && *x >= 0.0);
    moments.find(|m| !good(m)).map_or(Ok(()), |m| fault(Fault::NotFinite, format!("moments {m:?}")))
}
