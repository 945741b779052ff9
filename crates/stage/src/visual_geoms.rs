//! Shapes without physics that make the hand look like an Allegro hand, and the rail that it slides
//! on. MuJoCo's model has none of them, so they cost nothing while it runs.

use crate::config::StageConfig;
use crate::geometry::HALF_WIDTH;
use crate::hand::{
    DISTAL_LENGTH, FINGER_NAMES, FINGERS, LINK_SECTION, MOUNT, PALM_CENTRE, PALM_SIZE, TIP_HALF_LENGTH,
    TIP_RADIUS, root_side,
};

/// A shape on a body of the model.
pub(crate) struct VisualGeom {
    /// Name of the body; empty for the world.
    pub body: String,
    pub name: &'static str,
    /// `box`, `capsule` or `cylinder`.
    pub kind: &'static str,
    pub size: [f64; 3],
    pub pos: [f64; 3],
    pub quat: [f64; 4],
    pub rgba: [f32; 4],
}

/// Name of the rail's beam.
pub const RAIL_BEAM: &str = "rail_beam";

const MOTOR: [f32; 4] = [0.24, 0.25, 0.28, 1.0];
const COVER: [f32; 4] = [0.78, 0.79, 0.81, 1.0];
const METAL: [f32; 4] = [0.66, 0.68, 0.71, 1.0];
const PRINTED: [f32; 4] = [0.95, 0.95, 0.9, 1.0];

const STRAIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
/// A quarter of a turn about x: an axis along z comes to lie along y.
const ACROSS: [f64; 4] = [std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0];
/// A quarter of a turn about y: along x.
const FORWARD: [f64; 4] = [std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2, 0.0];

/// Radius and half length of the adapter between arm or rail and the palm, m.
const FLANGE: [f64; 2] = [0.0315, 0.025];
/// Half depth and half height of the rail's beam, m.
const BEAM: [f64; 2] = [0.008, 0.012];

/// Place of the adapter's far end in the palm frame, m: the flange of an arm is there.
pub const FLANGE_END: [f64; 3] = [PALM_CENTRE[0], 0.0, -PALM_SIZE[2] - 2.0 * FLANGE[1]];

pub(crate) fn visual_geoms(config: &StageConfig) -> Vec<VisualGeom> {
    let on = |body: &str, kind, size, pos, quat, rgba| VisualGeom {
        body: body.to_string(),
        name: "",
        kind,
        size,
        pos,
        quat,
        rgba,
    };
    let [px, py, pz] = PALM_SIZE.map(|size| size / 2.0);
    let [cx, cy, cz] = PALM_CENTRE;
    let thumb = if root_side(config.side, 0) > 0.0 { 1.0 } else { -1.0 };
    let [radius, half] = FLANGE;
    let mut all = vec![
        on("palm", "box", [0.0015, 0.8 * py, 0.8 * pz], [cx - px, cy, cz], STRAIGHT, COVER),
        on("palm", "cylinder", [radius, half, 0.0], [cx, 0.0, -PALM_SIZE[2] - half], STRAIGHT, METAL),
        // The thumb's joints and tip, on the capsule that the model has for it.
        on("palm", "cylinder", [0.0132, 0.0128, 0.0], [-0.018, thumb * 0.07, -0.046], FORWARD, MOTOR),
        on("palm", "cylinder", [0.0132, 0.0128, 0.0], [-0.018, thumb * 0.0725, -0.013], FORWARD, MOTOR),
        on(
            "palm",
            "capsule",
            [TIP_RADIUS, TIP_HALF_LENGTH, 0.0],
            [-0.018, thumb * 0.0755, 0.038],
            STRAIGHT,
            PRINTED,
        ),
    ];
    let [thick, wide] = LINK_SECTION.map(|size| size / 2.0);
    for finger in FINGER_NAMES.iter().take(FINGERS) {
        for part in ["proximal", "medial", "distal"] {
            // A motor turns each of these links at the frame's origin.
            let body = format!("{finger}_{part}");
            all.push(on(&body, "cylinder", [1.22 * thick, wide + 0.0012, 0.0], [0.0; 3], ACROSS, MOTOR));
        }
        let ring = [TIP_RADIUS + 0.0012, 0.002, 0.0];
        all.push(on(
            &format!("{finger}_distal"),
            "cylinder",
            ring,
            [0.0, 0.0, DISTAL_LENGTH + 0.002],
            STRAIGHT,
            MOTOR,
        ));
    }
    let [back, up] = MOUNT;
    // In the world: behind the adapter's far end.
    let at = [back - FLANGE_END[2] + BEAM[0], 0.0, up - FLANGE_END[0]];
    let size = [BEAM[0], HALF_WIDTH + 0.09, BEAM[1]];
    all.push(VisualGeom { name: RAIL_BEAM, ..on("", "box", size, at, STRAIGHT, METAL) });
    all
}
