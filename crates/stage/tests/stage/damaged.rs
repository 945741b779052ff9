//! Damaged snapshots are refused: a checkpoint may come from another version or a full disk.

use etude_stage::{PhysicalParams, Snapshot, StageConfig, World};

use crate::bench::{self, over};

/// The numbers of a snapshot in the order of its fields, through its `Debug` text: the fields are
/// private and this crate has no serialiser. The task's tests damage the stored form.
fn sleepers(snapshot: &Snapshot) -> usize {
    let text = format!("{snapshot:?}");
    let list = text.split("asleep: [").nth(1).unwrap().split(']').next().unwrap();
    list.split(',').filter(|n| n.trim().parse::<i32>().unwrap() >= 0).count()
}

#[test]
fn a_snapshot_of_a_world_without_fences_fits_one_with_fences() {
    // Fences are fixed: the state is the same. Restoring across kinds that differ in state must
    // fail instead.
    let open = StageConfig { fences: false, ..StageConfig::default() };
    let mut world = World::new(&open, &PhysicalParams::default()).unwrap();
    let mut fenced = bench::nominal();
    let press = over(&world, 1, 24, -0.012).unwrap();
    for _ in 0..20 {
        world.step(&press);
    }
    let snapshot = world.snapshot();
    assert!(sleepers(&snapshot) > 0);
    fenced.restore(&snapshot).unwrap();
    assert_eq!(fenced.pressed(), world.pressed());
    fenced.step(&press);
    assert!(fenced.pressed().contains(24));
}
