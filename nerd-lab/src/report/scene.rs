//! A frame of a replay as a picture: the painter's renderer of `assets/replay.js`, on plotters.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::plot::failed;
use super::replay::{Replay, Solid, isometry};
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
/// How much is seen of a ghost, and how far (m) it stands back, so that where both agree the first is seen.
const GHOST: f64 = 0.5;
const BEHIND: f64 = 0.02;

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
        let focus = 0.55 * f64::from(width + height);
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

    fn far(&self, x: &Point) -> f64 {
        (self.eye - x).norm()
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
/// If it cannot be drawn.
pub fn draw<B: DrawingBackend>(replay: &Replay, tracks: &[usize], frame: usize, area: &DrawingArea<B, Shift>) -> Result<()> {
    let poses = |track: &usize| replay.tracks.get(*track).and_then(|t| t.poses.get(frame).or(t.poses.last()));
    let all: Vec<_> = tracks.iter().filter_map(poses).collect();
    let (Some(start), Some(first)) = (replay.tracks.first().and_then(|t| t.poses.first()), all.first()) else { return Ok(()) };
    let camera = Camera::new(Vector3::from(replay.up), middle(first), distance(replay, start), area.dim_in_pixel());
    floor(replay, &camera, middle(first), area)?;
    let mut pieces: Vec<Piece> = Vec::new();
    for (k, poses) in all.into_iter().enumerate() {
        // What stands in the scene is drawn once.
        let shapes = replay.shapes.iter().filter(|s| k == 0 || s.link.is_some());
        let solids = shapes.flat_map(|solid| painted(solid, poses, k > 0, replay, &camera));
        pieces.extend(solids.map(|(far, colour, seen, width)| (far + BEHIND * k as f64, colour, seen, width)));
        let rods = replay.rods.iter().map(|[a, b]| (origin(&poses[*a]), origin(&poses[*b])));
        let stems = replay.shapes.iter().filter(|_| !replay.rods.is_empty()).filter_map(|s| Some((&poses[s.link?], s)));
        let stems = stems.map(|(p, s)| (origin(p), (isometry(p) * isometry(&s.pose)).translation.vector));
        let colour = RGBColor(125, 133, 144).mix(if k == 0 { 1.0 } else { GHOST });
        for (a, b) in rods.chain(stems) {
            let far = camera.far(&((a + b) / 2.0));
            let width = ((ROD * camera.focus / far) as u32).max(1);
            pieces.extend(camera.seen(&[a, b]).map(|seen| (far, colour, seen, width)));
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

/// Faces of a shape that look at the eye; of one that is round, long and too thin for faces, a stroke.
fn painted(solid: &Solid, poses: &[[f32; 7]], ghost: bool, replay: &Replay, camera: &Camera) -> Vec<Piece> {
    let at = solid.link.map_or_else(Isometry3::identity, |link| isometry(&poses[link])) * isometry(&solid.pose);
    let world = |x: Point| at * Point3::from(x) - Point3::origin();
    let colour = |shade: f64| match solid.link {
        None => HSLColor(solid.hue / 360.0, 0.08, shade + 0.15).mix(1.0),
        Some(_) if ghost => HSLColor(solid.hue / 360.0, 0.1, shade).mix(GHOST),
        Some(_) => HSLColor(solid.hue / 360.0, 0.45, shade).mix(1.0),
    };
    let middle = camera.far(&at.translation.vector);
    let wide = 2.0 * solid.size[0] * camera.focus / middle;
    if solid.kind == "capsule" && wide < THIN[0] {
        let seen = camera.seen(&[-1.0, 1.0].map(|s| world(Vector3::z() * (s * solid.size[1]))));
        return seen.map(|seen| (middle, colour(0.42), seen, wide.max(THIN[1]).round() as u32)).into_iter().collect();
    }
    let up = Vector3::from(replay.up);
    let (east, north) = ground(&up);
    let light = (up + east * 0.4 - north * 0.5).normalize();
    let face = |face: [Point; 4]| {
        let world = face.map(world);
        let across = (world[2] - world[0]).cross(&(world[3] - world[1]));
        let centre = (world[0] + world[1] + world[2] + world[3]) / 4.0;
        if across.norm() < 1e-12 || across.dot(&(camera.eye - centre)) < 0.0 {
            return None;
        }
        let shade = 0.34 + 0.40 * across.normalize().dot(&light).max(0.0);
        // What lies on a face of the scene is painted after it.
        let far = if solid.link.is_none() { world.iter().map(|x| camera.far(x)).fold(0.0, f64::max) } else { camera.far(&centre) };
        camera.seen(&world).map(|seen| (far, colour(shade), seen, 0))
    };
    faces(solid).into_iter().filter_map(face).collect()
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
                    if let Some(seen) = camera.seen(&[from, to]).and_then(|seen| inside(&seen, area.dim_in_pixel())) {
                        area.draw(&PathElement::new(seen, RGBColor(210, 214, 221))).map_err(failed::<B>)?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// The part of a line that is on the picture: plotters bends what is not.
fn inside(ends: &[(i32, i32)], (width, height): (u32, u32)) -> Option<[(i32, i32); 2]> {
    let [a, b] = [ends.first()?, ends.last()?].map(|p| Vector2::new(f64::from(p.0), f64::from(p.1)));
    let (step, mut from, mut to) = (b - a, 0.0_f64, 1.0_f64);
    for (at, by, most) in [(a.x, step.x, width), (a.y, step.y, height)] {
        // Where it does not move it is within for ever, or never: these are infinite then.
        let (enters, leaves) = (-at / by, (f64::from(most) - 1.0 - at) / by);
        (from, to) = (from.max(enters.min(leaves)), to.min(enters.max(leaves)));
    }
    (from < to).then(|| [from, to].map(|t| a + step * t).map(|p| (p.x.round() as i32, p.y.round() as i32)))
}
