//! The model as an MJCF document, written from [`PhysicalParams`].
//!
//! The world is built from exactly the text that `etude model export` prints; stock MuJoCo loads it
//! unchanged.
//!
//! Choices that matter for speed or physics:
//! - No gravity: the hand's controller compensates it, and the springs of the keys are at rest
//!   where gravity leaves them. The lower limit of a key is just below its rest angle, so that no
//!   resting key keeps a constraint active.
//! - Contact bits restrict collision tests to hand with keyboard (bit 1) and a finger with its
//!   neighbour (bit 2).
//! - Resting keys sleep (MuJoCo's `sleep` flag) until something touches them.

use etude_music::KEY_COUNT;

use crate::config::{Cone, Integrator, ModelOptions, StageConfig};
use crate::controller::Actuation;
use crate::geometry::{
    FENCE_FRICTION, FENCE_RISE, FENCE_THICKNESS, Fence, HALF_WIDTH, KeyShape, WHITE, fences, key_lateral,
};
use crate::hand::{
    DISTAL_LENGTH, FINGER_NAMES, FINGER_RANGE, FINGERS, JOINT_NAMES, JOINTS_PER_FINGER, LINK_MASSES,
    LINK_SECTION, LINKS, MOUNT, PAD, PALM_CENTRE, PALM_MASS, PALM_SIZE, RAIL, ROOT_SPACING, ROOT_Z, SPLAY,
    THUMB_MASS, TIP_CENTRE, TIP_HALF_LENGTH, TIP_RADIUS, root_side,
};
use crate::params::{JointRow, PhysicalParams, WorldRow};

/// Largest width and height of a picture, pixels: the model's off-screen buffer.
pub const MAX_PICTURE_SIZE: [u32; 2] = [1920, 1080];
/// The cameras' angle of view from top to bottom, degrees.
pub(crate) const FIELD_OF_VIEW_DEG: f64 = 30.0;
/// How far above rest a key may spring before its upper stop, rad.
const KEY_REBOUND: f64 = 0.01;
/// Speed below which a key may fall asleep, rad/s. With MuJoCo's default, keys fall asleep before
/// they are at rest, which visibly changed later presses. With this value positions stay within
/// 1e-8, and the time does not change measurably.
const SLEEP_TOLERANCE: f64 = 1e-10;
/// Impedance of joints' dry friction. With MuJoCo's default, 0.9, a joint that friction holds
/// creeps at tens of mrad/s.
const FIRM_FRICTION: &str = "0.999 0.999 0.001";
/// Contact bit of hand against keyboard.
const TOUCHES_KEYBOARD: u32 = 1;
/// Contact bit of a finger against its neighbour; the middle finger receives it, the outer ones
/// send it.
const TOUCHES_NEIGHBOUR: u32 = 2;

/// The whole model as an MJCF document.
pub fn mjcf(config: &StageConfig, params: &PhysicalParams) -> String {
    mjcf_with(config, params, &ModelOptions::default())
}

/// The same with model options other than the simulator's.
pub(crate) fn mjcf_with(config: &StageConfig, params: &PhysicalParams, options: &ModelOptions) -> String {
    let step = options.step_secs;
    let hard = 2.0 * step;
    let integrator = match options.integrator {
        Integrator::Euler => "Euler",
        Integrator::ImplicitFast => "implicitfast",
    };
    let cone = match options.cone {
        Cone::Elliptic => "elliptic",
        Cone::Pyramidal => "pyramidal",
    };
    let stops = if options.firm_stops { format!(r#" solreflimit="{hard} 1""#) } else { String::new() };
    let gravity = if options.gravity { -9.81 } else { 0.0 };
    let [width, height] = MAX_PICTURE_SIZE;
    let motors: String =
        lines(JOINT_NAMES, |name| format!("    <motor name=\"{name}\" joint=\"{name}\"/>\n"));
    format!(
        r#"<mujoco model="etude">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{step}" gravity="0 0 {gravity}" sleep_tolerance="{SLEEP_TOLERANCE}" cone="{cone}" impratio="10" integrator="{integrator}">
    <flag sleep="enable"/>
  </option>
  <visual><global offwidth="{width}" offheight="{height}" fovy="{FIELD_OF_VIEW_DEG}"/><quality shadowsize="2048" numquads="1" numslices="20" numstacks="12"/><headlight ambient="0.3 0.3 0.3" diffuse="0.25 0.25 0.25" specular="0 0 0"/></visual>
  <asset><texture type="skybox" builtin="gradient" rgb1="0.93 0.94 0.96" rgb2="0.62 0.66 0.72" width="64" height="384"/></asset>
  <statistic center="0 0 0.05" extent="0.5"/>
  <default>
    <geom solref="{hard} 1"/>
    <joint solreffriction="{hard} 1" solimpfriction="{FIRM_FRICTION}"{stops}/>
    <default class="visual"><geom contype="0" conaffinity="0"/></default>
  </default>
  <worldbody>
    <light directional="true" pos="0.3 -0.2 1.2" dir="-0.35 0.3 -1" diffuse="0.58 0.58 0.56" specular="0.15 0.15 0.15"/>
    <camera name="player" pos="0.62 0 0.48" xyaxes="0 1 0 -0.58 0 0.81"/>
    <camera name="side" pos="0.05 -0.75 0.18" xyaxes="1 0 0 0 0.15 0.99"/>
{keyboard}{hand}  </worldbody>
  <actuator>
{motors}  </actuator>
</mujoco>
"#,
        keyboard = keyboard(config, params, options),
        hand = hand(config, params, options),
    )
}

/// The texts of all items, joined.
fn lines<T>(items: impl IntoIterator<Item = T>, text: impl FnMut(T) -> String) -> String {
    items.into_iter().map(text).collect()
}

fn keyboard(config: &StageConfig, params: &PhysicalParams, options: &ModelOptions) -> String {
    let value = |quantity| params.world(quantity);
    let contact = |friction: f64| {
        format!(
            r#"contype="0" conaffinity="{TOUCHES_KEYBOARD}" priority="1" friction="{friction} 0.005 0.0001""#
        )
    };
    let (key_contact, fence_contact) = (contact(value(WorldRow::KeyFriction)), contact(FENCE_FRICTION));
    let yaw = options.keyboard_yaw_rad;
    let turn = if yaw == 0.0 {
        String::new()
    } else {
        format!(r#" quat="{} 0 0 {}""#, (yaw / 2.0).cos(), (yaw / 2.0).sin())
    };
    let fence = |(index, Fence { y, x: [rear, front] }): (usize, Fence)| {
        let (x, z) = ((rear + front) / 2.0, (WHITE.top() + FENCE_RISE) / 2.0);
        let (length, thickness) = ((front - rear) / 2.0, FENCE_THICKNESS / 2.0);
        format!(
            r#"      <geom name="fence_{index}" type="box" pos="{x} {y} {z}" size="{length} {thickness} {z}" rgba="0.55 0.6 0.58 1" {fence_contact}/>
"#
        )
    };
    let fences = if config.fences { lines(fences().enumerate(), fence) } else { String::new() };
    let floats = if options.gravity { r#" gravcomp="1""# } else { "" };
    // Each key stands in the world and not in the keyboard's body: MuJoCo keeps the axes of a
    // sleeping key relative to the centre of mass of everything under its outermost body, which
    // other keys would move while it sleeps.
    let key = |key: usize| {
        let shape = KeyShape::of(key);
        let [length, own_width, thick] = shape.size.map(|size| size / 2.0);
        let width = if etude_music::key_is_black(key) { own_width } else { options.white_width_m / 2.0 };
        let [x, y, z] = key_place(params, yaw, key);
        let [red, green, blue] = key_colour(key);
        let [low, stop] = key_range(params, options, key);
        let stiffness = value(WorldRow::KeyStiffness) * options.keys[key].stiffness;
        let spring = match key_spring_rest(params, options, key) {
            0.0 => String::new(),
            rest => format!(r#" springref="{rest}""#),
        };
        let (damping, armature) = (value(WorldRow::KeyDamping), value(WorldRow::KeyArmature));
        let (hinge, mass) = (-length, shape.mass);
        format!(
            r#"    <body name="key_{key}" pos="{x} {y} {z}"{turn}{floats}>
      <joint name="key_{key}" type="hinge" axis="0 1 0" pos="{hinge} 0 0" range="{low} {stop}" stiffness="{stiffness}"{spring} damping="{damping}" armature="{armature}"/>
      <geom name="key_{key}" type="box" size="{length} {width} {thick}" mass="{mass}" rgba="{red} {green} {blue} 1" {key_contact}/>
    </body>
"#
        )
    };
    let [depth, lateral, height] = keyboard_place(params);
    format!(
        r#"    <body name="keyboard" pos="{depth} {lateral} {height}"{turn}>
      <geom class="visual" type="box" pos="-0.125 0 0.02" size="0.05 {} 0.02" rgba="0.15 0.15 0.17 1"/>
{fences}    </body>
{keys}"#,
        HALF_WIDTH + 0.02,
        keys = lines(0..KEY_COUNT, key),
    )
}

/// Red, green and blue of key `key`, 0 to 1.
pub(crate) fn key_colour(key: usize) -> [f32; 3] {
    if etude_music::key_is_black(key) { [0.08; 3] } else { [0.95, 0.95, 0.93] }
}

/// Angles of a key's upper and lower stop, rad. A key that its spring presses upward rests against
/// the upper one.
pub(crate) fn key_range(params: &PhysicalParams, options: &ModelOptions, key: usize) -> [f64; 2] {
    let upper = if params.world(WorldRow::KeyPreload) > 0.0 { 0.0 } else { -KEY_REBOUND };
    [upper, KeyShape::of(key).max_angle() * options.keys[key].travel]
}

/// Angle at which a key's spring would be at rest, rad.
pub(crate) fn key_spring_rest(params: &PhysicalParams, options: &ModelOptions, key: usize) -> f64 {
    let preload = params.world(WorldRow::KeyPreload);
    if preload == 0.0 {
        return 0.0;
    }
    let [length, ..] = KeyShape::of(key).size;
    -preload * length / (params.world(WorldRow::KeyStiffness) * options.keys[key].stiffness)
}

/// World position of the body of key `key` on a keyboard that is turned by `yaw` rad, m.
pub(crate) fn key_place(params: &PhysicalParams, yaw: f64, key: usize) -> [f64; 3] {
    let shape = KeyShape::of(key);
    on_keyboard(params, yaw, [shape.x, key_lateral(key), shape.z])
}

/// World position of a point of a keyboard that is turned by `yaw` rad, m.
pub(crate) fn on_keyboard(params: &PhysicalParams, yaw: f64, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [depth, lateral, height] = keyboard_place(params);
    let (sine, cosine) = yaw.sin_cos();
    [depth + (x * cosine - y * sine), lateral + (x * sine + y * cosine), height + z]
}

/// World position of the keyboard's body, m.
pub(crate) fn keyboard_place(params: &PhysicalParams) -> [f64; 3] {
    [WorldRow::KeyboardDepth, WorldRow::KeyboardLateral, WorldRow::KeyboardHeight].map(|q| params.world(q))
}

/// Passive damping of joint `index` in MuJoCo's model, which under position actuation includes the
/// controller's (paper, appendix).
pub(crate) fn passive_damping(config: &StageConfig, params: &PhysicalParams, index: usize) -> f64 {
    let viscosity = params.joint(JointRow::Viscosity, index);
    match config.actuation {
        Actuation::Controlled => viscosity,
        Actuation::Position => viscosity + params.joint(JointRow::Damping, index),
    }
}

fn joint_attributes(config: &StageConfig, params: &PhysicalParams, index: usize) -> String {
    let damping = passive_damping(config, params, index);
    let (friction, armature) =
        (params.joint(JointRow::Friction, index), params.joint(JointRow::Armature, index));
    format!(r#"damping="{damping}" frictionloss="{friction}" armature="{armature}""#)
}

/// World position of the palm's body when the rail is centred, m.
pub(crate) const PALM_PLACE: [f64; 3] = [MOUNT[0], 0.0, MOUNT[1]];

/// Axes x and y of the palm in the world, and the world's y axis, along which the rail moves, in
/// the palm.
fn palm_axes([roll, pitch]: [f64; 2]) -> [[f64; 3]; 3] {
    // The palm faces down and the fingers point into the keyboard: palm x is world -z, palm y is
    // world -y, palm z is world -x.
    if (roll, pitch) == (0.0, 0.0) {
        return [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]];
    }
    let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
    // First about the world's y axis, then about its x axis. Fingertips lie toward -x of the mount.
    let turned = |[x, y, z]: [f64; 3]| {
        let (x, z) = (x * cp + z * sp, z * cp - x * sp);
        [x, y * cr - z * sr, y * sr + z * cr]
    };
    let axes = [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]].map(turned);
    [axes[0], axes[1], axes.map(|axis| axis[1])]
}

fn hand(config: &StageConfig, params: &PhysicalParams, options: &ModelOptions) -> String {
    let [back, _, up] = PALM_PLACE;
    let [x_axis, y_axis, along] = palm_axes(options.hand_tilt_rad).map(|[x, y, z]| format!("{x} {y} {z}"));
    let [sx, sy, sz] = PALM_SIZE.map(|size| size / 2.0);
    let [cx, cy, cz] = PALM_CENTRE;
    let rail = joint_attributes(config, params, RAIL);
    let thumb = if root_side(config.side, 0) > 0.0 { 1.0 } else { -1.0 };
    // The thumb is folded along the palm's far side; it adds its mass and touches nothing.
    format!(
        r#"    <body name="palm" pos="{back} 0 {up}" xyaxes="{x_axis} {y_axis}">
      <joint name="rail" type="slide" axis="{along}" range="{low} {HALF_WIDTH}" {rail}/>
      <geom class="visual" type="box" pos="{cx} {cy} {cz}" size="{sx} {sy} {sz}" mass="{PALM_MASS}" rgba="0.68 0.7 0.73 1"/>
      <geom class="visual" name="thumb" type="capsule" fromto="-0.018 {} -0.046 -0.018 {} 0.02" size="0.012" mass="{THUMB_MASS}" rgba="0.68 0.7 0.73 1"/>
{fingers}    </body>
"#,
        thumb * 0.07,
        thumb * 0.075,
        low = -HALF_WIDTH,
        fingers = lines(0..FINGERS, |index| finger(config, params, index)),
    )
}

fn finger(config: &StageConfig, params: &PhysicalParams, finger: usize) -> String {
    let (name, side) = (FINGER_NAMES[finger], root_side(config.side, finger));
    let outer = side != 0.0;
    let (y, z) = (side * ROOT_SPACING, ROOT_Z[usize::from(!outer)]);
    let half = -side * SPLAY / 2.0;
    let (cos, sin) = (half.cos(), half.sin());
    let (sx, sy) = (LINK_SECTION[0] / 2.0, LINK_SECTION[1] / 2.0);
    let contact = |touches: u32| {
        let (sends, receives) =
            if outer { (touches | TOUCHES_NEIGHBOUR, 0) } else { (touches, TOUCHES_NEIGHBOUR) };
        format!(r#"contype="{sends}" conaffinity="{receives}""#)
    };
    let (neighbour, both) = (contact(0), contact(TOUCHES_KEYBOARD));
    let joint = |number: usize, axis: &str| {
        let [low, high] = FINGER_RANGE[number];
        let attributes = joint_attributes(config, params, finger * JOINTS_PER_FINGER + number);
        format!(
            r#"<joint name="{name}_{number}" type="hinge" axis="{axis}" range="{low} {high}" {attributes}/>"#
        )
    };
    let link = |part: &str, length: f64, mass: f64, contact: &str| {
        let half = length / 2.0;
        format!(
            r#"<geom name="{name}_{part}" type="box" pos="0 0 {half}" size="{sx} {sy} {half}" mass="{mass}" rgba="0.68 0.7 0.73 1" {contact}/>"#
        )
    };
    let joints = [joint(0, "0 0 1"), joint(1, "0 1 0"), joint(2, "0 1 0"), joint(3, "0 1 0")];
    let links = [
        link("base", LINKS[0], LINK_MASSES[0], r#"class="visual""#),
        link("proximal", LINKS[1], LINK_MASSES[1], &neighbour),
        link("medial", LINKS[2], LINK_MASSES[2], &both),
        link("distal", DISTAL_LENGTH, LINK_MASSES[3], &both),
    ];
    let [base, proximal, medial, _] = LINKS;
    format!(
        r#"      <body name="{name}_base" pos="0 {y} {z}" quat="{cos} {sin} 0 0">
        {}
        {}
        <body name="{name}_proximal" pos="0 0 {base}">
          {}
          {}
          <body name="{name}_medial" pos="0 0 {proximal}">
            {}
            {}
            <body name="{name}_distal" pos="0 0 {medial}">
              {}
              {}
              <geom name="{name}_tip" type="capsule" pos="0 0 {TIP_CENTRE}" size="{TIP_RADIUS} {TIP_HALF_LENGTH}" mass="{tip}" rgba="0.95 0.95 0.9 1" {both}/>
              <site name="{name}_tip" pos="0 0 {end}" size="0.003"/>
              <site name="{name}_pad" pos="0 0 {PAD}" size="0.003"/>
            </body>
          </body>
        </body>
      </body>
"#,
        joints[0],
        links[0],
        joints[1],
        links[1],
        joints[2],
        links[2],
        joints[3],
        links[3],
        tip = LINK_MASSES[4],
        end = TIP_CENTRE + TIP_HALF_LENGTH,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::KeyFactors;

    /// Lines in which the two texts differ.
    fn differing<'a>(one: &'a str, other: &'a str) -> Vec<(&'a str, &'a str)> {
        assert_eq!(one.lines().count(), other.lines().count());
        one.lines().zip(other.lines()).filter(|(one, other)| one != other).collect()
    }

    #[test]
    fn options_change_what_they_say_and_nothing_else() {
        let (config, params) = (StageConfig::default(), PhysicalParams::default());
        let simulators = mjcf(&config, &params);
        let text = |options: &ModelOptions| mjcf_with(&config, &params, options);
        assert_eq!(simulators, text(&ModelOptions::default()));
        assert!(simulators.contains(r#"cone="elliptic" impratio="10" integrator="Euler""#));
        let options = ModelOptions {
            integrator: Integrator::ImplicitFast,
            cone: Cone::Pyramidal,
            ..ModelOptions::default()
        };
        let text_of_options = text(&options);
        let lines = differing(&simulators, &text_of_options);
        assert_eq!(lines.len(), 1);
        assert!(lines[0].1.contains(r#"cone="pyramidal" impratio="10" integrator="implicitfast""#));

        let turned = text(&ModelOptions { keyboard_yaw_rad: 0.01, ..ModelOptions::default() });
        let lines = differing(&simulators, &turned);
        assert_eq!(lines.len(), 1 + KEY_COUNT, "the keyboard's body and each key's");
        assert!(lines.iter().all(|(_, line)| line.contains("<body name=\"key") && line.contains("quat=")));

        let mut keys = ModelOptions::default().keys;
        keys[7] = KeyFactors { stiffness: 2.0, travel: 0.5 };
        let other_key = text(&ModelOptions { keys, ..ModelOptions::default() });
        let lines = differing(&simulators, &other_key);
        assert_eq!(lines.len(), 1);
        let stop = KeyShape::of(7).max_angle() / 2.0;
        assert!(lines[0].1.contains(&format!(r#"{stop}" stiffness="2""#)), "{}", lines[0].1);

        let narrower = text(&ModelOptions { white_width_m: 0.02, ..ModelOptions::default() });
        let lines = differing(&simulators, &narrower);
        assert_eq!(lines.len(), crate::geometry::WHITE_KEYS);
        assert!(lines.iter().all(|(_, line)| line.contains(r#"size="0.075 0.01 0.01125""#)));

        let firm = text(&ModelOptions { firm_stops: true, ..ModelOptions::default() });
        let lines = differing(&simulators, &firm);
        assert_eq!(lines.len(), 1);
        assert!(lines[0].1.contains("solreflimit") && !lines[0].0.contains("solreflimit"));
    }
}
