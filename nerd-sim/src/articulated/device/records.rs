//! Records of scenes and robots for the kernels, followed by the heights of height fields and the triangles of hulls.

use super::program::{COLLIDER, Reach, record};
use crate::prelude::*;
use crate::scene::{Field, Hull};

/// Records of a batch's environments, and which record each environment uses. Height fields and hulls follow the
/// records, once each; a record has its offset to them. With height fields, and in a family, each environment has its
/// own record.
///
/// # Errors
/// Those of [`record`], and robots that differ otherwise than by `[vary]`.
pub fn records(batch: &Batch, reach: Reach) -> Result<(Vec<f64>, Vec<i32>), String> {
    let mut records: Vec<f64> = Vec::new();
    let mut of: Vec<i32> = Vec::new();
    let mut last: Option<&Arc<Scene>> = None;
    let mut count = 0;
    let mut behind = Behind::default();
    for (env, scene) in batch.scenes.iter().enumerate() {
        let own = batch.of(env);
        if own.spec.vary != batch.system.spec.vary || own.spec.vary.is_none() && !batch.systems.is_empty() {
            return Err("on a device a batch's [vary] tells how its robots differ: draw them by it".into());
        }
        // Most environments share one scene.
        if reach.fields || !batch.systems.is_empty() || !last.is_some_and(|known| Arc::ptr_eq(known, scene)) {
            behind.take(scene, records.len());
            records.extend(record(scene, own, reach)?);
            (last, count) = (Some(scene), count + 1);
        }
        of.push(count - 1);
    }
    behind.write(&mut records);
    Ok((records, of))
}

/// The record of one scene, with its height fields and hulls.
///
/// # Errors
/// Those of [`record`].
pub(super) fn alone(scene: &Scene, system: &System, reach: Reach) -> Result<Vec<f64>, String> {
    let mut behind = Behind::default();
    let mut numbers = record(scene, system, reach)?;
    behind.take(scene, 0);
    behind.write(&mut numbers);
    Ok(numbers)
}

/// Height fields and hulls, once each, with the positions of the records that refer to them.
#[derive(Default)]
struct Behind {
    fields: Vec<(Field, Vec<usize>)>,
    hulls: Vec<(Hull, Vector3<f64>, Vec<usize>)>,
}

impl Behind {
    /// Collects the height fields and hulls of a scene with its record at `start`.
    fn take(&mut self, scene: &Scene, start: usize) {
        for (k, body) in scene.colliders.iter().enumerate() {
            let at = start + 3 + COLLIDER * k;
            if let Some(field) = &body.field {
                match self.fields.iter_mut().find(|(known, _)| known.shares(field)) {
                    Some((_, places)) => places.push(at),
                    None => self.fields.push((field.clone(), vec![at])),
                }
            } else if let Some(hull) = &body.hull {
                match self.hulls.iter_mut().find(|(known, ..)| known.shares(hull)) {
                    Some((.., places)) => places.push(at),
                    None => self.hulls.push((hull.clone(), body.ball.0, vec![at])),
                }
            }
        }
    }

    /// Appends height fields and hulls to the records, and writes the offsets to them into the records.
    fn write(self, records: &mut Vec<f64>) {
        let fields = self.fields.into_iter().map(|(field, places)| (field.numbers(), places));
        let hulls = self.hulls.into_iter().map(|(hull, middle, places)| (hull.numbers(&middle), places));
        for (numbers, places) in fields.chain(hulls) {
            let behind = records.len();
            places.into_iter().for_each(|at| records[at + 14] = (behind - at) as f64);
            records.extend(numbers);
        }
    }
}
