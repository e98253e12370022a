//! A frame of a replay as a picture: the painter's renderer of `assets/replay.js`, on plotters.

use nalgebra::Vector3;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::plot::failed;
use super::replay::{Replay, isometry};
use super::solids::Solid;
use crate::error::Result;

type Point = Vector3<f64>;
/// Something to paint: how far away, in which colour, where on the picture, and how wide a stroke is (px).
type Piece = (f64, RGBAColor, Vec<(i32, i32)>, u32);

/// Sides of what is round.
const SIDES: usize = 14;
/// Nearest that is drawn (m).
const NEAR: f64 = 0.05;
/// Width (px) below which what is round and long is a stroke, of this width at least.
const THIN: [f64; 2] = [4.0, 2.0];
/// Width (m) of rods.
const ROD: f64 = 0.03;

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

fn origin(pose: &[f32; 7]) -> Point {
    Vector3::new(f64::from(pose[0]), f64::from(pose[1]), f64::from(pose[2]))
}

fn middle(poses: &[[f32; 7]]) -> Point {
    poses.iter().map(origin).sum::<Point>() / poses.len().max(1) as f64
}

/// How far away a robot is seen whole (m).
fn distance(replay: &Replay, poses: &[[f32; 7]]) -> f64 {
    let target = middle(poses);
    let size = |link: usize| replay.shapes.iter().filter(|s| s.link == Some(link)).flat_map(|s| s.size.iter().copied()).fold(0.0, f64::max);
    let reach = poses.iter().enumerate().map(|(link, p)| (origin(p) - target).norm() + size(link));
    3.6 * reach.fold(0.14, f64::max) + 0.1
}

/// Draws a frame of tracks of a replay, all but the first as ghosts; a track that is over stays at its end.
///
/// # Errors
/// [`crate::Error::Draw`].
pub fn draw<B: DrawingBackend>(replay: &Replay, tracks: &[usize], frame: usize, area: &DrawingArea<B, Shift>) -> Result<()> {
    let poses = |track: &usize| replay.tracks[*track].poses.get(frame).or(replay.tracks[*track].poses.last());
    let all: Vec<_> = tracks.iter().filter_map(poses).collect();
    let (Some(start), Some(first)) = (replay.tracks[0].poses.first(), all.first()) else { return Ok(()) };
    let up = Vector3::from(replay.up);
    let camera = Camera::new(up, middle(first), distance(replay, start), area.dim_in_pixel());
    floor(replay, &camera, middle(first), area)?;
    let (east, north) = ground(&up);
    let light = (up + east * 0.4 - north * 0.5).normalize();
    let mut pieces: Vec<Piece> = Vec::new();
    for (k, poses) in all.into_iter().enumerate() {
        // What stands in the scene is drawn once.
        for solid in replay.shapes.iter().filter(|s| k == 0 || s.link.is_some()) {
            let at = solid.link.map_or_else(nalgebra::Isometry3::identity, |link| isometry(&poses[link])) * isometry(&solid.pose);
            let seen_at = |x: Point| (at * nalgebra::Point3::from(x)).coords;
            let colour = |shade: f64| match (solid.link, k) {
                (None, _) => HSLColor(solid.hue / 360.0, 0.08, shade + 0.15).mix(1.0),
                (_, 0) => HSLColor(solid.hue / 360.0, 0.45, shade).mix(1.0),
                _ => HSLColor(solid.hue / 360.0, 0.1, shade).mix(0.4),
            };
            let far = |x: &Point| (camera.eye - x).norm();
            let wide = 2.0 * solid.size[0] * camera.focus / far(&at.translation.vector);
            if solid.kind == "capsule" && wide < THIN[0] {
                let ends = [-1.0, 1.0].map(|s| seen_at(Vector3::z() * (s * solid.size[1])));
                let width = wide.max(THIN[1]).round() as u32;
                pieces.extend(camera.seen(&ends).map(|seen| (far(&at.translation.vector), colour(0.5), seen, width)));
                continue;
            }
            for face in faces(solid) {
                let world = face.map(seen_at);
                let across = (world[2] - world[0]).cross(&(world[3] - world[1]));
                let centre = (world[0] + world[1] + world[2] + world[3]) / 4.0;
                if across.norm() < 1e-12 || across.dot(&(camera.eye - centre)) < 0.0 {
                    continue;
                }
                let shade = 0.34 + 0.40 * across.normalize().dot(&light).max(0.0);
                // What lies on a face of the scene is painted after it.
                let depth = if solid.link.is_none() { world.iter().map(far).fold(0.0, f64::max) } else { far(&centre) };
                pieces.extend(camera.seen(&world).map(|seen| (depth, colour(shade), seen, 0)));
            }
        }
        let rods = replay.rods.iter().map(|[a, b]| (origin(&poses[*a]), origin(&poses[*b])));
        let shapes = replay.shapes.iter().filter(|_| !replay.rods.is_empty());
        let stems = shapes.filter_map(|s| Some(&poses[s.link?]).map(|p| (origin(p), (isometry(p) * isometry(&s.pose)).translation.vector)));
        for (a, b) in rods.chain(stems) {
            let far = (camera.eye - (a + b) / 2.0).norm();
            let width = ((ROD * camera.focus / far) as u32).max(1);
            pieces.extend(camera.seen(&[a, b]).map(|seen| (far, RGBColor(125, 133, 144).mix(if k == 0 { 1.0 } else { 0.4 }), seen, width)));
        }
    }
    pieces.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (_, colour, seen, width) in pieces {
        match seen[..] {
            [a, b] => area.draw(&PathElement::new([a, b], colour.stroke_width(width))),
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
