//! The Allegro hand: names, lengths, limits and masses, and where it is mounted.
//!
//! Palm frame: origin at the finger roots' level, `+z` along the straight fingers, `+x` out of the
//! palm on the side that the fingers curl to, `+y` lateral. Unless stated otherwise, lengths,
//! ranges and sizes are those of MuJoCo Menagerie's `wonik_allegro`, and masses those of the URDF
//! in github.com/simlabrobotics/allegro_hand_ros_v4.

use serde::{Deserialize, Serialize};

use crate::geometry::HALF_WIDTH;

/// Fingers that play. The thumb cannot reach the keys (paper, "Hardware Configuration").
pub const FINGERS: usize = 3;
/// Joints of one finger, from the root: roll about the finger's own axis, then three flexions.
pub const JOINTS_PER_FINGER: usize = 4;
/// Driven joints: all finger joints, then the rail.
pub const DRIVEN_JOINTS: usize = FINGERS * JOINTS_PER_FINGER + 1;
/// Index of the rail among the joints.
pub const RAIL: usize = DRIVEN_JOINTS - 1;

/// Names of the driven joints in the order of observations, actions and recordings.
pub const JOINT_NAMES: [&str; DRIVEN_JOINTS] = [
    "index_0", "index_1", "index_2", "index_3", "middle_0", "middle_1", "middle_2", "middle_3", "ring_0",
    "ring_1", "ring_2", "ring_3", "rail",
];
/// Names of the playing fingers, in joint order.
pub const FINGER_NAMES: [&str; FINGERS] = ["index", "middle", "ring"];

/// Which hand plays. Without the thumb the two differ only in which side the index finger is on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// The left hand (the paper's main experiments; the appendix uses the right one).
    #[default]
    Left,
    /// The right hand.
    Right,
}

/// Range of each finger joint, rad.
pub const FINGER_RANGE: [[f64; 2]; JOINTS_PER_FINGER] =
    [[-0.47, 0.47], [-0.196, 1.61], [-0.174, 1.709], [-0.227, 1.618]];

/// Range of a joint's target: rad, the rail in m.
pub fn joint_range(joint: usize) -> [f64; 2] {
    if joint == RAIL { [-HALF_WIDTH, HALF_WIDTH] } else { FINGER_RANGE[joint % JOINTS_PER_FINGER] }
}

/// Length of the four links of a finger, m: root to flexion joint, then to each next joint; the
/// last one runs to the centre of the fingertip's rounded end.
pub const LINKS: [f64; JOINTS_PER_FINGER] = [0.0164, 0.054, 0.0384, TIP_CENTRE + TIP_HALF_LENGTH];

/// Masses of base, proximal, medial, distal link and tip, kg.
pub const LINK_MASSES: [f64; 5] = [0.0119, 0.065, 0.0355, 0.0096, 0.0168];
/// Mass of the palm, kg.
pub const PALM_MASS: f64 = 0.4154;
/// Mass of all parts of the thumb, kg. The thumb is folded away.
pub const THUMB_MASS: f64 = 0.0176 + 0.0119 + 0.038 + 0.0388 + 0.0168;

/// Cross-section of the finger links (`x`, `y`), m.
pub const LINK_SECTION: [f64; 2] = [0.0196, 0.0275];
/// Size of the palm box, m, and its centre in the palm frame.
pub const PALM_SIZE: [f64; 3] = [0.0408, 0.113, 0.095];
/// Centre of the palm box in the palm frame, m.
pub const PALM_CENTRE: [f64; 3] = [-0.0093, 0.0, -0.0475];
/// Length of the distal link's body in front of the printed tip, m.
pub const DISTAL_LENGTH: f64 = 0.016;

/// Radius of the printed fingertip, m; this and the next two from
/// github.com/lasr-lab/learning-to-play-piano.
pub const TIP_RADIUS: f64 = 0.0085;
/// Half the length of the fingertip capsule's cylinder, m.
pub const TIP_HALF_LENGTH: f64 = 0.016;
/// Centre of the fingertip capsule beyond the last joint, m.
pub const TIP_CENTRE: f64 = 0.029;
/// Place of the finger pad beyond the last joint, m: the point from which the rewards measure the
/// distance to a key. It is inside the fingertip, as in RoboPianist and in the authors' code, so
/// that the reward still rises while a key is pressed down.
pub const PAD: f64 = 0.026;

/// Distance of an outer finger's root from the middle one's, m.
pub const ROOT_SPACING: f64 = 0.0435;
/// How far the outer fingers' roots lie behind the middle one's, along the fingers, m: `[outer,
/// middle]`.
pub const ROOT_Z: [f64; 2] = [-0.001542, 0.0007];
/// Outward splay of the outer fingers, rad.
pub const SPLAY: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Place of the palm's origin when the rail is centred: toward the player and up, m. The height is
/// that of lasr-lab/learning-to-play-piano. It is 1 cm further back than there, so that a finger
/// with an upright tip reaches the front of the white keys within the range of its second joint.
pub const MOUNT: [f64; 2] = [0.10, 0.12];

/// Lateral sign of a finger's root in the palm frame: the index finger of a right hand is at `+y`.
pub fn root_side(side: Side, finger: usize) -> f64 {
    let right = 1.0 - finger as f64;
    match side {
        Side::Right => right,
        Side::Left => -right,
    }
}

/// Lateral offset of a finger's root in the world when the rail is centred, m: with the palm facing
/// down, the palm's `+y` is the keyboard's `-y`.
pub fn root_lateral(side: Side, finger: usize) -> f64 {
    -root_side(side, finger) * ROOT_SPACING
}
