//! A frame of a replay as a picture: the painter's renderer of `assets/replay.js`, on plotters.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::plot::failed;
use super::replay::{Replay, Solid};
use crate::error::Result;

type Point = Vector3<f64>;
/// Something to paint: how far away, in which colour, where on the picture.
type Piece = (f64, RGBColor, Vec<(i32, i32)>);

/// Sides of what is round.
const SIDES: usize = 14;
/// Nearest that is drawn (m).
const NEAR: f64 = 0.05;

/// Where the eye is, and how it sees.
struct Camera {
    eye: Point,
    right: Point,
    above: Point,
    back: Point,
    focus: f64,
    middle: (f64, f64),
}

impl Camera {
    /// Looks at a point from a little above, `distance` (m) away.
    fn new(up: Point, target: Point, distance: f64, (width, height): (u32, u32)) -> Self {
        let (turn, lift) = (-0.6_f64, 0.3_f64);
        let (east, north) = ground(&up);
        let flat = east * turn.sin() - north * turn.cos();
        let back = flat * lift.cos() + up * lift.sin();
        let right = up.cross(&back).normalize();
        let focus = 1.1 * f64::from(width.min(height));
        let middle = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        Self { eye: target + back * distance, right, above: back.cross(&right), back, focus, middle }
    }

    /// Pixel of a point, unless it is behind the eye.
    fn see(&self, x: &Point) -> Option<(i32, i32)> {
        let r = x - self.eye;
        let depth = -r.dot(&self.back);
        let at = |k: f64| self.focus * k / depth;
        (depth > NEAR).then(|| ((self.middle.0 + at(r.dot(&self.right))) as i32, (self.middle.1 - at(r.dot(&self.above))) as i32))
    }

    fn seen(&self, points: &[Point]) -> Option<Vec<(i32, i32)>> {
        points.iter().map(|x| self.see(x)).collect()
    }
}

/// Two directions along the ground.
fn ground(up: &Point) -> (Point, Point) {
    let east = if up.x.abs() > 0.9 { Vector3::y() } else { Vector3::x() };
    (east, up.cross(&east))
}

/// Faces of a shape in its own frame.
fn faces(solid: &Solid) -> Vec<[Point; 4]> {
    let size = &solid.size;
    let mut out = Vec::new();
    if solid.kind == "box" {
        let corner = |x: f64, y: f64, z: f64| Vector3::new(x * size[0], y * size[1], z * size[2]);
        for s in [-1.0, 1.0] {
            out.push([corner(s, -1.0, -1.0), corner(s, s, -s), corner(s, 1.0, 1.0), corner(s, -s, s)]);
            out.push([corner(-1.0, s, -1.0), corner(-s, s, s), corner(1.0, s, 1.0), corner(s, s, -s)]);
            out.push([corner(-1.0, -1.0, s), corner(s, -s, s), corner(1.0, 1.0, s), corner(-s, s, s)]);
        }
        return out;
    }
    let (radius, half) = (size[0], size[1]);
    let rings: Vec<(f64, f64)> = if solid.kind == "cylinder" {
        vec![(0.0, -half), (radius, -half), (radius, half), (0.0, half)]
    } else {
        let cap = |k: usize, shift: f64| {
            let a = std::f64::consts::PI * (k as f64 / 8.0 - 0.5);
            (radius * a.cos(), radius * a.sin() + shift)
        };
        (0..=4).map(|k| cap(k, -half)).chain((4..=8).map(|k| cap(k, half))).collect()
    };
    let at = |ring: (f64, f64), i: usize| {
        let a = std::f64::consts::TAU * i as f64 / SIDES as f64;
        Vector3::new(ring.0 * a.cos(), ring.0 * a.sin(), ring.1)
    };
    for pair in rings.windows(2) {
        out.extend((0..SIDES).map(|i| [at(pair[0], i), at(pair[0], i + 1), at(pair[1], i + 1), at(pair[1], i)]));
    }
    out
}

fn isometry(pose: &[f32; 7]) -> Isometry3<f64> {
    let [x, y, z, i, j, k, w] = pose.map(f64::from);
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)))
}

fn origin(pose: &[f32; 7]) -> Point {
    Vector3::new(f64::from(pose[0]), f64::from(pose[1]), f64::from(pose[2]))
}

fn middle(poses: &[[f32; 7]]) -> Point {
    poses.iter().map(origin).sum::<Point>() / poses.len().max(1) as f64
}

/// How far away a robot is seen whole (m).
fn distance(replay: &Replay, poses: &[[f32; 7]]) -> f64 {
    let target = middle(poses);
    let size = |link: usize| replay.shapes.iter().filter(|s| s.link == link).flat_map(|s| s.size.iter().copied()).fold(0.0, f64::max);
    let reach = poses.iter().enumerate().map(|(link, p)| (origin(p) - target).norm() + size(link));
    3.6 * reach.fold(0.14, f64::max) + 0.1
}

/// Draws a frame of one track of a replay; a track that is over stays at its end.
///
/// # Errors
/// [`crate::Error::Draw`].
pub fn draw<B: DrawingBackend>(replay: &Replay, track: usize, frame: usize, area: &DrawingArea<B, Shift>) -> Result<()> {
    let all = &replay.tracks[track].poses;
    let (Some(first), Some(poses)) = (replay.tracks[0].poses.first(), all.get(frame).or(all.last())) else { return Ok(()) };
    let up = Vector3::from(replay.up);
    let camera = Camera::new(up, middle(poses), distance(replay, first), area.dim_in_pixel());
    floor(replay, &camera, middle(poses), area)?;
    let (east, north) = ground(&up);
    let light = (up + east * 0.4 - north * 0.5).normalize();
    let mut polygons: Vec<Piece> = Vec::new();
    for solid in &replay.shapes {
        let at = isometry(&poses[solid.link]) * isometry(&solid.pose);
        for face in faces(solid) {
            let world = face.map(|x| at * nalgebra::Point3::from(x)).map(|p| p.coords);
            let across = (world[2] - world[0]).cross(&(world[3] - world[1]));
            let centre = (world[0] + world[1] + world[2] + world[3]) / 4.0;
            if across.norm() < 1e-12 || across.dot(&(camera.eye - centre)) < 0.0 {
                continue;
            }
            let shade = 0.34 + 0.40 * across.normalize().dot(&light).max(0.0);
            let (r, g, b) = HSLColor((210.0 + 137.5 * solid.link as f64) % 360.0 / 360.0, 0.45, shade).to_backend_color().rgb;
            polygons.extend(camera.seen(&world).map(|seen| ((camera.eye - centre).norm(), RGBColor(r, g, b), seen)));
        }
    }
    let shape_rods =
        replay.shapes.iter().map(|s| (origin(&poses[s.link]), (isometry(&poses[s.link]) * isometry(&s.pose)).translation.vector));
    for (a, b) in replay.rods.iter().map(|[a, b]| (origin(&poses[*a]), origin(&poses[*b]))).chain(shape_rods) {
        polygons.extend(camera.seen(&[a, b]).map(|seen| ((camera.eye - (a + b) / 2.0).norm(), RGBColor(125, 133, 144), seen)));
    }
    polygons.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (far, colour, seen) in polygons {
        match seen[..] {
            [a, b] => area.draw(&PathElement::new([a, b], colour.stroke_width(((0.03 * camera.focus / far) as u32).max(1)))),
            _ => area.draw(&Polygon::new(seen, colour.filled())),
        }
        .map_err(failed::<B>)?;
    }
    Ok(())
}

/// A grid of metres on every plane, around the robot.
fn floor<B: DrawingBackend>(replay: &Replay, camera: &Camera, target: Point, area: &DrawingArea<B, Shift>) -> Result<()> {
    let (east, north) = ground(&Vector3::from(replay.up));
    for (normal, offset) in &replay.planes {
        let normal = Vector3::from(*normal);
        let a = if normal.dot(&north).abs() > 0.9 { east } else { north }.cross(&normal).normalize();
        let (b, start) = (normal.cross(&a), normal * *offset);
        let (i0, j0) = ((target - start).dot(&a).round(), (target - start).dot(&b).round());
        let point = |i: i32, j: i32| start + a * (i0 + f64::from(i)) + b * (j0 + f64::from(j));
        for k in -5..=5 {
            for j in -5..5 {
                for (from, to) in [(point(k, j), point(k, j + 1)), (point(j, k), point(j + 1, k))] {
                    if let Some(seen) = camera.seen(&[from, to]) {
                        area.draw(&PathElement::new(seen, RGBColor(210, 214, 221))).map_err(failed::<B>)?;
                    }
                }
            }
        }
    }
    Ok(())
}
