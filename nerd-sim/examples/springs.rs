//! A hand-written solver drops a ball onto the ground. Contact forces are springs and dampers at contact points.
//! `cargo run --release -p nerd-sim --example springs`

use nalgebra::Isometry3;
use nerd_sim::prelude::*;
use nerd_suite::bodies::Body;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ball = Body { shape: r#"<sphere radius="0.1"/>"#.into(), inertia: [0.004; 3], ..Default::default() };
    let (system, state, h) = (ball.system()?, &mut Body::at([0.0, 0.0, 0.3])[..], 1e-4);
    let (robot, scene) = (&system.robot, &*system.scene("ground")?);
    let (mut data, mut events) = (Data::new(robot), Vec::new());
    for _ in 0..20_000 {
        let (q, twist) = robot.split(state);
        let (mut velocity, mut tau) = (twist.to_local(robot, q), vec![0.0; robot.nv()]);
        contacts(&system, scene, state, &mut data, &mut events);
        for (point, event) in
            robot.contact_points.iter().zip(&events).filter(|(point, event)| event.distance < point.radius)
        {
            let material = scene.colliders[event.collider].material.mean(&system.spec.material);
            let frame = FixedFrame { name: String::new(), link: Some(point.link), pose: Isometry3::from(point.local) };
            let v_n = event.normal.dot(&robot.velocity(q, &velocity, &frame).lin);
            let force = event.normal
                * -(material.stiffness * (event.distance - point.radius) + material.damping * v_n.min(0.0));
            let more = data.jacobian(robot, q, &frame, Axes::World).fixed_rows::<3>(3).tr_mul(&force); // J^T f
            tau.iter_mut().zip(&more).for_each(|(tau, more)| *tau += more);
        }
        velocity.accelerate(data.forward_dynamics(robot, q, &velocity, &tau, &scene.gravity)?, h);
        velocity.advance(robot, state, h);
    }
    println!("after 2 s its centre is {:.4} m above the ground; m g / k below its radius is 0.0990 m", state[2]);
    Ok(())
}
