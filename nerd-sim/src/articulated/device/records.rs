//! What kernels know of a batch's scenes and robots: records, and behind them the heights of ground that is not flat.

use super::program::{COLLIDER, Reach, record};
use crate::prelude::*;
use crate::scene::Field;

/// The records of a batch's environments and which is whose. Heights stand behind them once each; a record says how far behind. On ground that is
/// not flat, and in a family, each environment has its own.
///
/// # Errors
/// As [`record`]; that robots differ in another way than by `[vary]`.
pub fn records(batch: &Batch, reach: Reach) -> Result<(Vec<f64>, Vec<i32>), String> {
    let (mut records, mut of, mut last): (Vec<f64>, Vec<i32>, Option<&Arc<Scene>>) = (Vec::new(), Vec::new(), None);
    let (mut count, mut fields): (_, Vec<(Field, Vec<usize>)>) = (0, Vec::new());
    for (env, scene) in batch.scenes.iter().enumerate() {
        let own = batch.of(env);
        if own.spec.vary != batch.system.spec.vary || own.spec.vary.is_none() && !batch.systems.is_empty() {
            return Err("on a device a batch's [vary] tells how its robots differ: draw them by it".into());
        }
        // Environments mostly share one.
        if reach.fields || !batch.systems.is_empty() || !last.is_some_and(|known| Arc::ptr_eq(known, scene)) {
            for (k, body) in scene.colliders.iter().enumerate() {
                let Some(field) = &body.field else { continue };
                let at = records.len() + 3 + COLLIDER * k;
                match fields.iter_mut().find(|(known, _)| known.shares(field)) {
                    Some((_, places)) => places.push(at),
                    None => fields.push((field.clone(), vec![at])),
                }
            }
            records.extend(record(scene, own, reach)?);
            (last, count) = (Some(scene), count + 1);
        }
        of.push(count - 1);
    }
    for (field, places) in fields {
        let behind = records.len();
        places.into_iter().for_each(|at| records[at + 14] = (behind - at) as f64);
        records.extend(field.numbers());
    }
    Ok((records, of))
}
