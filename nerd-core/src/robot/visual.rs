//! Reads the visual shapes of a URDF's links. Visual shapes do not affect motion, so unreadable ones are left out.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::{Form, ShapeKind, Solid};

/// Largest coordinate, angle and size (m, rad).
const MAX_COORDINATE: f64 = 1e6;

/// The `<visual>`s of each link, in the order of the file.
#[derive(Default)]
pub(super) struct Looks(Vec<Vec<Visual>>);

/// One `<visual>`, as far as it was read.
#[derive(Default)]
struct Visual {
    /// `None` before the first `<origin>`; `Some(None)` if that cannot be read.
    origin: Option<Option<Isometry3<f64>>>,
    geometries: usize,
    form: Option<Option<Form>>,
}

impl Looks {
    /// Takes one element: `path` holds the element names from the root to it, `attributes` its `(name, value)` pairs.
    pub fn open(&mut self, path: &[&str], attributes: &[(String, String)]) {
        let ["robot", "link", inner @ ..] = path else { return };
        if inner.is_empty() {
            self.0.push(Vec::new());
        }
        let Some(link) = self.0.last_mut().filter(|_| inner.first() == Some(&"visual")) else { return };
        if inner.len() == 1 {
            link.push(Visual::default());
        }
        let Some(visual) = link.last_mut() else { return };
        match inner[1..] {
            ["origin"] => _ = visual.origin.get_or_insert_with(|| origin(attributes)),
            ["geometry"] => visual.geometries += 1,
            ["geometry", kind] if visual.geometries == 1 => {
                _ = visual.form.get_or_insert_with(|| form(kind, attributes))
            }
            _ => {}
        }
    }

    /// The visual solids, `[link][visual]`.
    pub fn solids(self) -> Vec<Vec<Solid>> {
        let solid = |visual: Visual| {
            Some(Solid {
                pose: visual.origin.unwrap_or(Some(Isometry3::identity()))?,
                form: visual.form??,
                surface: None,
            })
        };
        self.0.into_iter().map(|link| link.into_iter().filter_map(solid).collect()).collect()
    }
}

fn word<'a>(attributes: &'a [(String, String)], key: &str) -> Option<&'a str> {
    attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
}

fn numbers<const N: usize>(attributes: &[(String, String)], key: &str) -> Option<[f64; N]> {
    let all: Vec<f64> = word(attributes, key)?.split_whitespace().filter_map(|x| x.parse().ok()).collect();
    all.try_into().ok().filter(|all: &[f64; N]| all.iter().all(|x| x.abs() < MAX_COORDINATE))
}

fn origin(attributes: &[(String, String)]) -> Option<Isometry3<f64>> {
    let three = |key: &str| word(attributes, key).map_or(Some([0.0; 3]), |_| numbers::<3>(attributes, key));
    let [x, y, z] = three("xyz")?;
    let [roll, pitch, yaw] = three("rpy")?;
    Some(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

fn form(kind: &str, attributes: &[(String, String)]) -> Option<Form> {
    let number = |key: &str| numbers::<1>(attributes, key).map(|[x]| x).filter(|x| *x > 0.0);
    let radius = number("radius");
    let half_length = number("length").map(|length| 0.5 * length);
    Some(Form::Shape(match kind {
        "box" => ShapeKind::Box { half: 0.5 * Vector3::from(numbers::<3>(attributes, "size")?) },
        "sphere" => ShapeKind::Sphere { radius: radius? },
        "cylinder" => ShapeKind::Cylinder { radius: radius?, half_length: half_length? },
        "capsule" => ShapeKind::Capsule { radius: radius?, half_length: half_length? },
        _ => {
            let file = word(attributes, "filename")?.into();
            return Some(Form::Mesh { file, scale: numbers(attributes, "scale").unwrap_or([1.0; 3]).into() });
        }
    }))
}
