//! Reads the bodies of an MJCF with joints, geoms and sites; frames, replicas and attached models are expanded.

use super::compiler::{Compiler, MIN_LENGTH};
use super::element::Element;
use super::joint::{Joint, Kind};
use super::model::Body;
use super::placement::Placement;
use super::read::Reader;
use super::scope::Scope;
use crate::internal::*;

/// Maximum number of copies that all `<replicate>` of a file make.
const MAX_REPLICAS: usize = 100_000;

impl Reader {
    /// Adds the children of an element to the scope's body.
    pub fn fill(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        for child in &e.children {
            self.child(child, scope)?;
        }
        Ok(())
    }

    fn child(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        self.names.take(e, "body", scope, self.depth > 0)?;
        let compiler = &scope.source.compiler;
        let class = || scope.source.classes.of(e, scope.class.as_deref());
        let own = &mut self.model.bodies[scope.body];
        match e.tag.as_str() {
            "geom" => {
                let mut geom = class()?.geom.clone();
                geom.apply(e, compiler)?;
                geom.check(e)?;
                geom.hang(&scope.at);
                own.geoms.push(geom);
            }
            "site" => {
                let mut site = class()?.site.clone();
                site.apply(e, compiler)?;
                site.check(e)?;
                site.hang(&scope.at);
                own.sites.push(site);
            }
            "joint" | "freejoint" => self.joint(e, scope)?,
            "inertial" if scope.body == 0 => return Err(e.refused("the world has no inertia; put it into a body")),
            "inertial" => own.inertial = Some(inertial(e, compiler)?),
            "body" => self.body(e, scope)?,
            "frame" => {
                let pose = pose(e, compiler)?;
                self.fill(e, &scope.within(e, &pose))?;
            }
            "replicate" => self.replicate(e, scope)?,
            "attach" => self.attach(e, scope)?,
            "camera" => _ = compiler.turn(e)?,
            "light" if e.array("dir")?.is_some_and(|dir| Vector3::from(dir).norm() < MIN_LENGTH) => {
                return Err(e.refused("dir has no direction"));
            }
            "light" => {}
            _ => return Err(e.refused("it is not supported; write it out as bodies, or leave it out")),
        }
        Ok(())
    }

    pub fn body(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        let weightless = e.number("gravcomp")?.unwrap_or(0.0);
        let mut body = Body::new(
            scope.at.frame * pose(e, &scope.source.compiler)?,
            scope.body,
            Element { children: Vec::new(), ..e.clone() },
            scope.source.clone(),
        );
        body.name = e.word("name").map(|name| scope.at.name(name));
        (body.mocap, body.weightless) = (e.flag("mocap").unwrap_or(false), weightless);
        if body.mocap
            && (scope.body != 0 || e.children.iter().any(|c| ["joint", "freejoint"].contains(&c.tag.as_str())))
        {
            return Err(e.refused("a mocap body is in the world and has no joint"));
        }
        self.model.bodies.push(body);
        let body = self.model.bodies.len() - 1;
        let inside = scope.within(e, &Isometry3::identity());
        let at = Placement { frame: Isometry3::identity(), ..inside.at.clone() };
        self.fill(e, &Scope { body, at, ..inside })
    }

    fn joint(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        if scope.body == 0 {
            return Err(e.refused("the world has no joint; put it into a body"));
        }
        let mut joint = if e.tag == "freejoint" {
            Joint::free(e.word("name"))
        } else {
            let mut joint = scope.source.classes.of(e, scope.class.as_deref())?.joint.clone();
            joint.apply(e)?;
            joint.in_si(&scope.source.compiler)
        };
        joint.check(e)?;
        joint.align = joint.kind == Kind::Free && e.tristate("align").flatten().unwrap_or(scope.source.compiler.align);
        let own = joint.name.clone();
        for (kind, is) in joint.kinds(&scope.source.compiler) {
            own.iter().filter(|_| is).for_each(|name| _ = self.names.add(kind, name, scope));
        }
        joint.hang(&scope.at);
        if let (false, Some(own), Some(new)) = (scope.at.suffix.is_empty(), own, &joint.name) {
            self.copied.entry(format!("{}{own}", scope.at.prefix)).or_default().push(new.clone());
        }
        let joints = &mut self.model.bodies[scope.body].joints;
        joints.push(joint);
        if joints.iter().map(|joint| joint.kind.velocities()).sum::<usize>() > 6 {
            return Err(e.refused("its body has more than 6 degrees of freedom; write a second body"));
        }
        Ok(())
    }

    /// Expands `<replicate>`: copies, each displaced by an offset and a rotation relative to the previous copy.
    fn replicate(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        let count =
            e.whole("count")?.filter(|n| *n > 0).ok_or_else(|| e.refused("count is a number of copies above zero"))?;
        self.copies += count as usize;
        if self.copies > MAX_REPLICAS {
            return Err(e.refused(format!("more than {MAX_REPLICAS} copies")));
        }
        let digits = (count - 1).to_string().len();
        let angles: [f64; 3] = e.array("euler")?.unwrap_or_default();
        let offset: Vector3<f64> = e.array("offset")?.unwrap_or_default().into();
        let mut place = Vector3::zeros();
        for k in 0..count {
            // MuJoCo multiplies the Euler angles by k; it does not compose the rotation k times.
            let turned = scope.source.compiler.euler(angles.map(|angle| angle * k as f64));
            let pose = Isometry3::from_parts(place.into(), turned);
            let suffix = format!("{}{k:0digits$}", e.text("sep").unwrap_or_default());
            let inside = scope.within(e, &pose);
            let at = Placement { suffix: suffix + &scope.at.suffix, ..inside.at.clone() };
            self.fill(e, &Scope { at, ..inside })?;
            place += turned * offset;
        }
        Ok(())
    }
}

fn pose(e: &Element, compiler: &Compiler) -> Result<Isometry3<f64>, UrdfError> {
    let mut pose = Isometry3::identity();
    compiler.pose(e, &mut pose).map(|()| pose)
}

/// Pose, mass and inertia of an `<inertial>`.
fn inertial(e: &Element, compiler: &Compiler) -> Result<(Isometry3<f64>, f64, Matrix3<f64>), UrdfError> {
    let mass =
        e.number("mass")?.filter(|mass| *mass >= 0.0).ok_or_else(|| e.refused("it needs a mass of zero or more"))?;
    let inertia = match (e.array::<3>("diaginertia")?, e.array::<6>("fullinertia")?) {
        (Some(d), _) => Matrix3::from_diagonal(&d.into()),
        (None, Some([xx, yy, zz, xy, xz, yz])) => Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
        (None, None) => Matrix3::zeros(),
    };
    Ok((pose(e, compiler)?, mass, inertia))
}
