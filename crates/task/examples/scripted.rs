//! Lag experiment.
use etude_stage::*;
use etude_stage::geometry::*;
fn main() {
    let cfg = StageConfig::default();
    let mut w = World::new(&cfg, &PhysicalParams::default()).unwrap();
    let side = cfg.side;
    for (key, hover, xx) in [(24usize, 0.010, None), (24, 0.010, Some(0.035)), (24, 0.006, None), (25, 0.010, None)] {
        let shape = KeyShape::of(key);
        let [x0, y, _] = key_target(key);
        let x = xx.unwrap_or(x0);
        let top = shape.top() + hand::TIP_RADIUS;
        let lever = (x - (shape.x - shape.size[0] / 2.0)) / shape.size[0] * shape.travel;
        for depth in [0.7, 0.85, 1.0, 1.2, 1.5, 2.0] {
            for finger in [1usize] {
                w.reset();
                let mut t = w.start_pose();
                let base = kinematics::fingertip(side, finger, &[0.0, 1.0, 0.6, 0.0], 0.0);
                let rail = y - base[1];
                t[RAIL] = rail;
                let f = |z: f64| kinematics::reach(side, finger, [x, y, z], rail).unwrap();
                t[finger * 4..][..4].copy_from_slice(&f(top + hover));
                w.reset_to(&t);
                for _ in 0..10 { w.step(&t); }
                let t0 = w.time_secs();
                t[finger * 4..][..4].copy_from_slice(&f(top - depth * lever));
                let (mut on, mut off) = (vec![], vec![]);
                let mut steady = 0.0;
                let mut peak: f64 = 0.0;
                for s in 0..20 {
                    w.step(&t);
                    on.extend(w.events().iter().map(|e| (e.key, e.velocity > 0, ((e.secs - t0) * 1e3).round())));
                    steady = w.key_travel(key);
                    peak = peak.max(steady);
                    let _ = s;
                }
                let t1 = w.time_secs();
                let tip = w.fingertip(finger)[2] - top;
                t[finger * 4..][..4].copy_from_slice(&f(top + hover));
                for _ in 0..20 {
                    w.step(&t);
                    off.extend(w.events().iter().map(|e| (e.key, e.velocity > 0, ((e.secs - t1) * 1e3).round())));
                }
                println!("key {key} x {x:.3} hover {hover} depth {depth}: on {on:?} off {off:?} steady {steady:.2} peak {peak:.2} tip {:.1} wanted {:.1} mm", tip*1e3, -depth*lever*1e3);
            }
        }
    }
    for d in [0.005, 0.01, 0.0232, 0.0465, 0.07, 0.1, 0.2] {
        w.reset();
        let mut t = w.start_pose();
        for _ in 0..5 { w.step(&t); }
        t[RAIL] = d;
        print!("rail {d}:");
        for _ in 0..14 { w.step(&t); print!(" {:.1}", w.joints()[RAIL] * 1e3); }
        println!();
    }
    for d in [0.05, 0.1, 0.2] {
        w.reset();
        let mut t = w.start_pose();
        for _ in 0..5 { w.step(&t); }
        t[4] += d;
        print!("roll {d}:");
        for _ in 0..8 { w.step(&t); print!(" {:.3}", w.joints()[4]-t[4]+d); }
        println!();
    }
}
