//! The ground on which a derived robot starts.

use toml::{Table, Value};

use crate::internal::*;
use crate::robots::mjcf::Description;
use crate::scene::GROUND;
use crate::scene::{SceneSpec, Surfaces, flat, up, world};

/// Least cosine between the up axis and the normal of a plane that counts as ground.
const MIN_UP_COSINE: f64 = 0.1;
/// Penetration (m) beyond which a robot is lifted out of the solids of its file's world.
const MAX_PENETRATION: f64 = 1e-3;
/// Lifting of a robot out of solids: height of a step as a share of the robot's extent, and maximum number of steps.
const LIFT_STEP: (f64, usize) = (0.05, 200);

/// A plane, and the world axis that leads up from the plane.
pub(crate) struct Ground {
    pub up: Vector3<f64>,
    pub plane: Plane,
    /// Index (0 to 2) of the world axis that leads up from the plane, and its sign (1 or -1).
    axis: (usize, f64),
    /// The other solids of the file's world, and their contact properties.
    solids: Scene,
    surfaces: Surfaces,
}

impl Ground {
    /// Finds the ground of the scene `data_scene`: from a TOML, else the robot's file or a built-in world,
    /// else level.
    pub fn of(own: &Table, file: &Description, (stands, surfaces): (&[Collider], &Surfaces)) -> Self {
        let key = |key: &str| own.get(key).or_else(|| file.keys.get(key));
        let gravity =
            key("gravity").and_then(|x| x.clone().try_into::<[f64; 3]>().ok()).unwrap_or([0.0, 0.0, -GRAVITY]).into();
        let up = up(&gravity);
        let name = key("data_scene").and_then(Value::as_str).unwrap_or_default();
        let scenes = own.get("scene").and_then(Value::as_array).into_iter().flatten();
        let named = scenes.filter(|scene| scene.get("name").and_then(Value::as_str) == Some(name));
        let own = named
            .filter_map(|scene| scene.clone().try_into::<SceneSpec>().ok())
            .map(|scene| flat(&gravity, &scene.plane))
            .next();
        let ground = |plane: &Plane| plane.normal.dot(&up) > MIN_UP_COSINE;
        let files = || file.planes().find(ground);
        // No built-in world rises above the plane through the origin at a robot's start.
        let worlds =
            || Some(Plane { offset: 0.0, ..world(name, &gravity, Material::default())?.colliders.first()?.plane? });
        let files_own = own.is_none() && name == GROUND;
        let solids = stands.iter().filter(|body| files_own && body.plane.is_none()).cloned().collect();
        let plane = own.or_else(|| if name == GROUND { files() } else { worlds() }).filter(ground);
        let plane = plane.unwrap_or(Plane { normal: up, offset: 0.0 });
        let axis = up.component_mul(&plane.normal).imax();
        let solids = Scene { colliders: solids, ..Scene::free(gravity) };
        Self { up, axis: (axis, up[axis].signum()), plane, solids, surfaces: surfaces.clone() }
    }

    /// Distance (m) along the up axis that lifts a robot out of the solids. It is 0 if no contact point is deeper than
    /// [`MAX_PENETRATION`], or if no tested distance clears the robot.
    pub fn lift(&self, robot: &Robot, state: &[f64], [extent, clearance]: [f64; 2]) -> f64 {
        let mut data = Data::new(robot);
        let mut state = state.to_vec();
        let step = LIFT_STEP.0 * extent;
        let most = LIFT_STEP.1;
        let mut nearest = || {
            kinematics(robot, &state, &mut data);
            let gap = |point: &ContactPoint| self.solids.meets(point, &data, &self.surfaces).distance;
            let gaps = robot.contact_points.iter().map(|point| [gap(point), point.radius]);
            let nearest = gaps.fold([f64::INFINITY; 2], |[a, b], [gap, radius]| [a.min(gap), b.min(gap - radius)]);
            state[self.axis.0] += self.axis.1 * step;
            nearest
        };
        if self.solids.colliders.is_empty() || nearest()[1] > -MAX_PENETRATION {
            return 0.0;
        }
        (1..=most).find(|_| nearest()[0] >= clearance).map_or(0.0, |k| k as f64 * step)
    }

    /// Cosine of the angle between the world axis that leads up and the plane's normal.
    pub fn slope(&self) -> f64 {
        self.plane.normal[self.axis.0] * self.axis.1
    }

    /// Height (m) along the up axis of a root whose robot touches the plane. `low`: position (m) of the robot's lowest
    /// point relative to the root, along the plane's normal.
    pub fn height(&self, low: f64) -> f64 {
        (self.plane.offset - low) / self.slope()
    }

    /// The world position (m) at `height` (m) along the up axis.
    pub fn place(&self, height: f64) -> [f64; 3] {
        let mut place = [0.0; 3];
        place[self.axis.0] = self.axis.1 * height;
        place
    }

    /// Ranges of the world position (m) between two heights (m) along the up axis.
    pub fn places(&self, low: f64, high: f64) -> [Range; 3] {
        let mut places = [Range::default(); 3];
        let ends = [low, high].map(|height| self.axis.1 * height);
        places[self.axis.0] = Range { low: ends[0].min(ends[1]), high: ends[0].max(ends[1]) };
        places
    }
}
