//! Mass properties of triangle meshes.

use nerd_core::spatial::parallel_axis;

use crate::internal::*;

/// The part of a mesh that has mass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MassOf {
    /// Pyramids between the faces and the mesh's centre, all with positive volume.
    Pyramids,
    /// The enclosed volume.
    Volume,
    /// The volume of the convex hull.
    Hull,
    /// The faces, as a shell of uniform thickness.
    Surface,
}

/// Mass, centre of mass and inertia at a density of 1 kg/m^3, or for a surface 1 kg/m^2. `None` for a mesh without
/// mass.
pub(super) fn properties(vertices: &[Vector3<f64>], faces: &[[u32; 3]], of: MassOf) -> Option<BodyInertia> {
    let hull;
    let (vertices, faces) = if of == MassOf::Hull || faces.is_empty() {
        hull = crate::robots::mesh::faces(vertices)?;
        (&hull.0[..], &hull.1[..])
    } else {
        (vertices, faces)
    };
    let triangles = || faces.iter().map(|face| face.map(|k| vertices[k as usize]));
    let mut area = 0.0;
    let mut middle = Vector3::zeros();
    for [a, b, c] in triangles() {
        let own = 0.5 * (b - a).cross(&(c - a)).norm();
        (area, middle) = (area + own, middle + (a + b + c) * (own / 3.0));
    }
    middle /= area;
    let found = if of == MassOf::Surface {
        sum(triangles(), &middle, |[a, b, c]| (0.5 * (b - a).cross(&(c - a)).norm(), false))
    } else {
        let signed = |[a, b, c]: [Vector3<f64>; 3]| {
            let volume = a.dot(&b.cross(&c)) / 6.0;
            (if of == MassOf::Pyramids { volume.abs() } else { volume }, true)
        };
        // First about the area-weighted mean of face centres, then about the resulting centre of mass.
        let first = sum(triangles(), &middle, signed)?;
        // The centre of mass of the second pass may differ from the first; MuJoCo ignores this.
        let moved = |second: &BodyInertia| parallel_axis(second.mass, &(second.com - first.com));
        sum(triangles(), &first.com, signed).map(|own| BodyInertia {
            com: first.com,
            inertia: own.inertia + moved(&own),
            ..own
        })
    };
    found.filter(|own| own.mass > 1e-14 && own.mass.is_finite())
}

/// Sums mass properties over triangles about the point `from` (m). `mass_of` gives a mass (kg), and whether it is the
/// mass of the pyramid between triangle and `from` (`true`) or of the triangle itself (`false`).
fn sum(
    triangles: impl Iterator<Item = [Vector3<f64>; 3]>,
    from: &Vector3<f64>,
    mass_of: impl Fn([Vector3<f64>; 3]) -> (f64, bool),
) -> Option<BodyInertia> {
    let mut mass = 0.0;
    let mut first = Vector3::zeros();
    let mut second = Matrix3::zeros();
    for corners in triangles {
        let corners = corners.map(|v| v - from);
        let (own, pyramid) = mass_of(corners);
        let total: Vector3<f64> = corners.iter().sum();
        let squares: Matrix3<f64> = corners.iter().map(|v| v * v.transpose()).sum();
        // Moments of a triangle with corners v: first `sum v / 3`, second `(sum v v^T + sum v (sum v)^T) / 12`. The
        // moments of the pyramid between triangle and origin are 3/4 (first) and 3/5 (second) of the triangle's.
        let shares = if pyramid { [0.75, 0.6] } else { [1.0, 1.0] };
        mass += own;
        first += total * (own * shares[0] / 3.0);
        second += (squares + total * total.transpose()) * (own * shares[1] / 12.0);
    }
    if mass.is_nan() || mass <= 0.0 {
        return None;
    }
    let com = first / mass;
    let about = second - com * com.transpose() * mass;
    Some(BodyInertia { mass, com: com + from, inertia: Matrix3::identity() * about.trace() - about })
}
