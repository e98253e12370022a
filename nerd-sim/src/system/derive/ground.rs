//! The ground that a derived robot starts on.

use toml::{Table, Value};

use crate::internal::*;
use crate::scene::GROUND;
use crate::scene::{SceneSpec, Surfaces, flat, up, world};
use crate::system::mjcf::Description;

/// Least cosine between the up axis and the normal of a plane that is ground.
const STEEPEST: f64 = 0.1;
/// Depth (m) beyond which a robot is lifted out of the solids of its file's world.
const DEEP: f64 = 1e-3;
/// Step of lifting, as a share of its extent, and most steps.
const STEP: (f64, usize) = (0.05, 200);

/// A plane, and the world's axis that leads up from it.
pub(crate) struct Ground {
    pub up: Vector3<f64>,
    pub plane: Plane,
    /// That axis by number, and its sense.
    axis: (usize, f64),
    /// The other solids of a file's world, and their contact properties.
    solids: Scene,
    surfaces: Surfaces,
}

impl Ground {
    /// The ground of the data's scene under gravity, from a TOML or else the robot's file; level ground where neither has any.
    pub fn of(own: &Table, file: &Description, (stands, surfaces): (&[Collider], &Surfaces)) -> Self {
        let key = |key: &str| own.get(key).or_else(|| file.keys.get(key));
        let gravity = key("gravity").and_then(|x| x.clone().try_into::<[f64; 3]>().ok()).unwrap_or([0.0, 0.0, -GRAVITY]).into();
        let (up, name) = (up(&gravity), key("data_scene").and_then(Value::as_str).unwrap_or_default());
        let scenes = own.get("scene").and_then(Value::as_array).into_iter().flatten();
        let named = scenes.filter(|scene| scene.get("name").and_then(Value::as_str) == Some(name));
        let own = named.filter_map(|scene| scene.clone().try_into::<SceneSpec>().ok()).map(|scene| flat(&gravity, &scene.plane)).next();
        let ground = |plane: &Plane| plane.normal.dot(&up) > STEEPEST;
        let files = || file.planes().find(ground);
        // Of the built-in worlds, none rises above the plane through the origin at a robot's start.
        let worlds = || Some(Plane { offset: 0.0, ..world(name, &gravity, Material::default())?.colliders.first()?.plane? });
        let files_own = own.is_none() && name == GROUND;
        let solids = stands.iter().filter(|body| files_own && body.plane.is_none()).cloned().collect();
        let plane = own.or_else(|| if name == GROUND { files() } else { worlds() }).filter(ground);
        let plane = plane.unwrap_or(Plane { normal: up, offset: 0.0 });
        let axis = up.component_mul(&plane.normal).imax();
        let solids = Scene { colliders: solids, ..Scene::free(gravity) };
        Self { up, axis: (axis, up[axis].signum()), plane, solids, surfaces: surfaces.clone() }
    }

    /// Distance up the axis (m) that lifts a robot deep inside a solid clear of it; 0 if it is not deep inside, or cannot be cleared.
    pub fn lift(&self, robot: &Robot, state: &[f64], [extent, clearance]: [f64; 2]) -> f64 {
        let (mut data, mut state) = (Data::new(robot), state.to_vec());
        let (step, most) = (STEP.0 * extent, STEP.1);
        let mut nearest = || {
            kinematics(robot, &state, &mut data);
            let gap = |point: &ContactPoint| self.solids.meets(point, &data, &self.surfaces).distance;
            let gaps = robot.contact_points.iter().map(|point| [gap(point), point.radius]);
            let nearest = gaps.fold([f64::INFINITY; 2], |[a, b], [gap, radius]| [a.min(gap), b.min(gap - radius)]);
            state[self.axis.0] += self.axis.1 * step;
            nearest
        };
        if self.solids.colliders.is_empty() || nearest()[1] > -DEEP {
            return 0.0;
        }
        (1..=most).find(|_| nearest()[0] >= clearance).map_or(0.0, |k| k as f64 * step)
    }

    /// Cosine between the axis and the plane's normal.
    pub fn slope(&self) -> f64 {
        self.plane.normal[self.axis.0] * self.axis.1
    }

    /// Height of the root up the axis (m), for a robot whose lowest point is at this distance from it along the plane's normal.
    pub fn height(&self, low: f64) -> f64 {
        (self.plane.offset - low) / self.slope()
    }

    /// A position at this height up the axis (m).
    pub fn place(&self, height: f64) -> [f64; 3] {
        let mut place = [0.0; 3];
        place[self.axis.0] = self.axis.1 * height;
        place
    }

    /// Positions from one height up the axis to another (m).
    pub fn places(&self, low: f64, high: f64) -> [Range; 3] {
        let mut places = [Range::default(); 3];
        let ends = [low, high].map(|height| self.axis.1 * height);
        places[self.axis.0] = Range { low: ends[0].min(ends[1]), high: ends[0].max(ends[1]) };
        places
    }
}
