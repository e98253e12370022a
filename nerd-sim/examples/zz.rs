use nalgebra::Vector3;
use nerd_core::contact::ContactEvent;
use nerd_sim::articulated::Draft;
use nerd_sim::dataset::read_shard;
use nerd_sim::prelude::*;
use std::io::Write;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let system = System::named(&a[1]).unwrap();
    let n: usize = a[4].parse().unwrap();
    let (r, _) = read_shard(std::path::Path::new(&a[2])).unwrap();
    let (d, j, c) = (system.robot.state_dim(), system.robot.joint_count(), system.robot.contact_points.len());
    let mut out = std::io::BufWriter::new(std::fs::File::create(&a[3]).unwrap());
    let mut draft = Draft::new(&system, n).unwrap();
    let g = Vector3::new(0.0, 0.0, -9.81);
    let t0 = std::time::Instant::now();
    for t in 0..r.trajectories {
        for f in 0..r.frames {
            let mut s = r.states[(t * (r.frames + 1) + f) * d..][..d].to_vec();
            let row = t * r.frames + f;
            let v = |x: &[f64]| Vector3::new(x[0], x[1], x[2]);
            let events: Vec<_> = (0..c)
                .map(|k| {
                    let i = row * c + k;
                    let (p1, normal) = (v(&r.points[3 * i..]), v(&r.normals[3 * i..]));
                    let distance = r.depths[i];
                    ContactEvent { p0: p1 + normal * distance, p1, normal, distance, collider: 0 }
                })
                .collect();
            draft.step(&system, &g, &events, &r.torques[row * j..][..j], &mut s).unwrap();
            for x in &s {
                out.write_all(&(*x as f32).to_le_bytes()).unwrap();
            }
        }
    }
    eprintln!("{:.1} us each", t0.elapsed().as_secs_f64() * 1e6 / (r.trajectories * r.frames) as f64);
}
