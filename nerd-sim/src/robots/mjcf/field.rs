//! Reads height fields among the assets of an MJCF.

use super::element::Element;
use super::scope::Scope;
use crate::internal::*;
use crate::scene::Field;

/// Height fields with their names; in place of an unreadable field stands the error.
pub(super) type Fields = Vec<(String, Result<Field, String>)>;
/// `[rows, columns]`, row 0 at the least y, and heights `[row][column]`.
type Heights = ([usize; 2], Vec<f32>);
/// Maximum number of heights in a field.
const MAX_HEIGHTS: f64 = 1e7;

/// All height fields of a file.
pub(super) fn fields(root: &Element, scope: &Scope) -> Result<Fields, UrdfError> {
    let mut all = Fields::new();
    for e in root.all("asset").flat_map(|asset| asset.all("hfield")) {
        let (file, name) = scope.asset(e)?;
        if all.iter().any(|(other, _)| *other == name) {
            return Err(e.refused(format!("another height field is called `{}`, too", name.escape_debug())));
        }
        let size = e.array::<4>("size")?.filter(|size| size.iter().all(|x| *x > 0.0));
        let size =
            size.ok_or_else(|| e.refused("size has four numbers above zero: half lengths, height, depth of its foot"))?;
        let heights = match &file {
            Some(_) if ["nrow", "ncol"].iter().any(|key| e.has(key)) => {
                return Err(e.refused("its file says nrow and ncol; leave them out"));
            }
            Some(file) => read(file).map_err(|reason| format!("{}: {reason}", file.display())),
            None => Ok(listed(e)?),
        };
        all.push((name, heights.and_then(|heights| field(heights, size))));
    }
    Ok(all)
}

/// Heights from the attributes of an `<hfield>`, where the first row has the largest y.
fn listed(e: &Element) -> Result<Heights, UrdfError> {
    let mut counts = [0.0; 2];
    for (key, count) in ["nrow", "ncol"].into_iter().zip(&mut counts) {
        *count = e.whole(key)?.unwrap_or(0) as f64;
        if *count < 2.0 {
            return Err(e.refused(format!("{key} is {count}; without a file, 2 or more are needed")));
        }
    }
    let all = counts[0] * counts[1];
    if all > MAX_HEIGHTS {
        return Err(e.refused(format!("it has {all} heights; {MAX_HEIGHTS} are the most")));
    }
    let [nrow, ncol] = counts.map(|x| x as usize);
    let given = e.list("elevation")?.unwrap_or_else(|| vec![0.0; nrow * ncol]);
    if given.len() != nrow * ncol {
        return Err(e.refused(format!(
            "elevation has {} numbers, not nrow x ncol, which are {}",
            given.len(),
            nrow * ncol
        )));
    }
    Ok(([nrow, ncol], given.rchunks(ncol).flatten().map(|x| *x as f32).collect()))
}

#[cfg(feature = "meshes")]
fn read(file: &Path) -> Result<Heights, String> {
    crate::robots::mesh::heights(file)
}

#[cfg(not(feature = "meshes"))]
fn read(_: &Path) -> Result<Heights, String> {
    Err("this build reads no such files; switch the feature `meshes` on".into())
}

/// The height field with these heights, scaled to the range from 0 to `height` (m). `x`, `y`: half lengths (m); `base`:
/// depth of the block below 0 (m).
fn field(([nrow, ncol], heights): Heights, [x, y, height, base]: [f64; 4]) -> Result<Field, String> {
    let [low, high] = heights.iter().fold([f32::MAX, f32::MIN], |[low, high], h| [low.min(*h), high.max(*h)]);
    let range = if f64::from(high - low) > 1e-14 { high - low } else { 1.0 };
    let at = |k: usize| height * f64::from((heights[k % nrow * ncol + k / nrow] - low) / range);
    let cell = |half: f64, n: usize| 2.0 * half / (n.max(2) - 1) as f64;
    Field::block([cell(x, ncol), cell(y, nrow)], [ncol, nrow], (0..nrow * ncol).map(at).collect(), base)
}
