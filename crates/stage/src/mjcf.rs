//! The world as MJCF, written from [`PhysicalParams`].
//!
//! Text rather than calls: what is built is what `etude model export` prints, and stock MuJoCo loads it unchanged.
//!
//! Choices that matter for speed or physics:
//! - No gravity: the hand's controller compensates it (as the authors' does), and the keys' springs are at rest where
//!   gravity leaves them. The lower limit stands just below, so that no resting key keeps a constraint active.
//! - Contact bits let only what can touch be tested: hand with keyboard (bit 1), a finger with its neighbour (bit 2).
//! - Resting keys sleep (MuJoCo's `sleep` flag) until something touches them.

use std::fmt::Write as _;

use etude_music::KEYS;

use crate::config::{Cone, Integrator, ModelOptions, StageConfig};
use crate::controller::Actuation;
use crate::geometry::{
    FENCE_FRICTION, FENCE_RISE, FENCE_THICKNESS, HALF_WIDTH, KeyShape, WHITE, fences, key_lateral,
};
use crate::hand::{
    DISTAL_LENGTH, FINGER_JOINTS, FINGER_NAMES, FINGER_RANGE, JOINT_NAMES, LINK_MASSES, LINK_SECTION, LINKS,
    MOUNT, PAD, PALM_CENTRE, PALM_MASS, PALM_SIZE, RAIL, ROOT_SPACING, ROOT_Z, SPLAY, THUMB_MASS, TIP_CENTRE,
    TIP_HALF_LENGTH, TIP_RADIUS, root_side,
};
use crate::params::{Joint, PhysicalParams, World};

/// Greatest width and height of a picture, pixels: the model's off-screen buffer.
pub const LARGEST_PICTURE: [u32; 2] = [1920, 1080];
/// How far above rest a key may spring before its upper stop, rad.
const KEY_REBOUND: f64 = 0.01;
/// Speed below which a key may fall asleep, rad/s. MuJoCo's own choice freezes keys on their way to rest: that changed
/// what later presses did, visibly. This one keeps positions within a hundred-millionth and costs no measurable time.
const SLEEP_TOLERANCE: f64 = 1e-10;
/// Contact bit of hand against keyboard.
const TOUCHES_KEYBOARD: u32 = 1;
/// Contact bit of a finger against its neighbour; the middle finger receives it, the outer ones send it.
const TOUCHES_NEIGHBOUR: u32 = 2;

/// The whole model as an MJCF document.
pub fn mjcf(config: &StageConfig, params: &PhysicalParams) -> String {
    mjcf_with(config, params, &ModelOptions::default())
}

/// The same with options of its own.
pub(crate) fn mjcf_with(config: &StageConfig, params: &PhysicalParams, options: &ModelOptions) -> String {
    let mut xml = String::with_capacity(32 * 1024);
    // Writing to a string cannot fail.
    let _ = document(&mut xml, config, params, options);
    xml
}

fn document(
    out: &mut String,
    config: &StageConfig,
    params: &PhysicalParams,
    options: &ModelOptions,
) -> std::fmt::Result {
    let step = options.step_secs;
    let integrator = match options.integrator {
        Integrator::Euler => "Euler",
        Integrator::ImplicitFast => "implicitfast",
    };
    let cone = match options.cone {
        Cone::Elliptic => "elliptic",
        Cone::Pyramidal => "pyramidal",
    };
    writeln!(out, r#"<mujoco model="etude">"#)?;
    writeln!(out, r#"  <compiler angle="radian" autolimits="true"/>"#)?;
    writeln!(
        out,
        r#"  <option timestep="{step}" gravity="0 0 0" sleep_tolerance="{SLEEP_TOLERANCE}" cone="{cone}" impratio="10" integrator="{integrator}">"#
    )?;
    writeln!(out, r#"    <flag sleep="enable"/>"#)?;
    writeln!(out, r#"  </option>"#)?;
    writeln!(
        out,
        r#"  <visual><global offwidth="{}" offheight="{}"/><quality shadowsize="2048"/><headlight ambient="0.3 0.3 0.3" diffuse="0.25 0.25 0.25" specular="0 0 0"/></visual>"#,
        LARGEST_PICTURE[0], LARGEST_PICTURE[1],
    )?;
    writeln!(
        out,
        r#"  <asset><texture type="skybox" builtin="gradient" rgb1="0.93 0.94 0.96" rgb2="0.62 0.66 0.72" width="64" height="384"/></asset>"#
    )?;
    writeln!(out, r#"  <statistic center="0 0 0.05" extent="0.5"/>"#)?;
    writeln!(out, r#"  <default>"#)?;
    writeln!(out, r#"    <geom solref="{} 1"/>"#, 2.0 * step)?;
    if options.firm_joints {
        let hard = 2.0 * step;
        writeln!(
            out,
            r#"    <joint solreflimit="{hard} 1" solreffriction="{hard} 1" solimpfriction="0.999 0.999 0.001"/>"#
        )?;
    }
    writeln!(out, r#"    <default class="visual"><geom contype="0" conaffinity="0"/></default>"#)?;
    writeln!(out, r#"  </default>"#)?;
    writeln!(out, r#"  <worldbody>"#)?;
    writeln!(
        out,
        r#"    <light pos="0.3 -0.2 1.2" dir="-0.2 0.1 -1" diffuse="0.55 0.55 0.55" specular="0.1 0.1 0.1"/>"#
    )?;
    writeln!(out, r#"    <camera name="player" pos="0.62 0 0.48" xyaxes="0 1 0 -0.58 0 0.81"/>"#)?;
    writeln!(out, r#"    <camera name="side" pos="0.05 -0.75 0.18" xyaxes="1 0 0 0 0.15 0.99"/>"#)?;
    keyboard(out, config, params, options)?;
    hand(out, config, params)?;
    writeln!(out, r#"  </worldbody>"#)?;
    writeln!(out, r#"  <actuator>"#)?;
    for name in JOINT_NAMES {
        writeln!(out, r#"    <motor name="{name}" joint="{name}"/>"#)?;
    }
    writeln!(out, r#"  </actuator>"#)?;
    writeln!(out, r#"</mujoco>"#)
}

fn keyboard(
    out: &mut String,
    config: &StageConfig,
    params: &PhysicalParams,
    options: &ModelOptions,
) -> std::fmt::Result {
    let value = |quantity| params.world(quantity);
    let friction = value(World::KeyFriction);
    let contact = |friction: f64| {
        format!(
            r#"contype="0" conaffinity="{TOUCHES_KEYBOARD}" priority="1" friction="{friction} 0.005 0.0001""#
        )
    };
    let (key_contact, fence_contact) = (contact(friction), contact(FENCE_FRICTION));
    let yaw = options.keyboard_yaw_rad;
    let turn = if yaw == 0.0 {
        String::new()
    } else {
        format!(r#" quat="{} 0 0 {}""#, (yaw / 2.0).cos(), (yaw / 2.0).sin())
    };
    let [depth, lateral, height] = keyboard_place(params);
    writeln!(out, r#"    <body name="keyboard" pos="{depth} {lateral} {height}"{turn}>"#)?;
    writeln!(
        out,
        r#"      <geom class="visual" type="box" pos="-0.125 0 0.02" size="0.05 {} 0.02" rgba="0.15 0.15 0.17 1"/>"#,
        HALF_WIDTH + 0.02
    )?;
    if config.fences {
        let top = WHITE.top() + FENCE_RISE;
        for (index, fence) in fences().enumerate() {
            let [rear, front] = fence.x;
            writeln!(
                out,
                r#"      <geom name="fence_{index}" type="box" pos="{} {} {}" size="{} {} {}" rgba="0.9 0.75 0.1 1" {fence_contact}/>"#,
                (rear + front) / 2.0,
                fence.y,
                top / 2.0,
                (front - rear) / 2.0,
                FENCE_THICKNESS / 2.0,
                top / 2.0,
            )?;
        }
    }
    writeln!(out, r#"    </body>"#)?;
    // Each key stands by itself in the world and not in the keyboard: MuJoCo keeps the axes of a sleeping key relative
    // to the centre of mass of everything under its outermost body, and other keys would move that while it sleeps.
    for key in 0..KEYS {
        let shape = KeyShape::of(key);
        let [length, width, thick] = shape.size;
        let [x, y, z] = key_place(params, yaw, key);
        let colour = if etude_music::key_is_black(key) { "0.08 0.08 0.08 1" } else { "0.95 0.95 0.93 1" };
        writeln!(out, r#"    <body name="key_{key}" pos="{x} {y} {z}"{turn}>"#)?;
        writeln!(
            out,
            r#"      <joint name="key_{key}" type="hinge" axis="0 1 0" pos="{} 0 0" range="{} {}" stiffness="{}" damping="{}" armature="{}"/>"#,
            -length / 2.0,
            -KEY_REBOUND,
            shape.max_angle() * options.keys[key].travel,
            value(World::KeyStiffness) * options.keys[key].stiffness,
            value(World::KeyDamping),
            value(World::KeyArmature),
        )?;
        writeln!(
            out,
            r#"      <geom name="key_{key}" type="box" size="{} {} {}" mass="{}" rgba="{colour}" {key_contact}/>"#,
            length / 2.0,
            width / 2.0,
            thick / 2.0,
            shape.mass,
        )?;
        writeln!(out, r#"    </body>"#)?;
    }
    Ok(())
}

/// Where the body of key `key` stands on a keyboard that is turned by `yaw` rad, m.
pub(crate) fn key_place(params: &PhysicalParams, yaw: f64, key: usize) -> [f64; 3] {
    let shape = KeyShape::of(key);
    on_keyboard(params, yaw, [shape.x, key_lateral(key), shape.z])
}

/// Where a point of a keyboard that is turned by `yaw` rad is in the world, m.
pub(crate) fn on_keyboard(params: &PhysicalParams, yaw: f64, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [depth, lateral, height] = keyboard_place(params);
    let (sine, cosine) = yaw.sin_cos();
    [depth + (x * cosine - y * sine), lateral + (x * sine + y * cosine), height + z]
}

/// Where the keyboard's body stands, m.
pub(crate) fn keyboard_place(params: &PhysicalParams) -> [f64; 3] {
    [World::KeyboardDepth, World::KeyboardLateral, World::KeyboardHeight].map(|q| params.world(q))
}

/// Passive damping of joint `index` in the world: under position actuation all damping is there (paper, appendix).
pub(crate) fn passive_damping(config: &StageConfig, params: &PhysicalParams, index: usize) -> f64 {
    let viscosity = params.joint(Joint::Viscosity, index);
    match config.actuation {
        Actuation::Controlled => viscosity,
        Actuation::Position => viscosity + params.joint(Joint::Damping, index),
    }
}

fn joint_attributes(config: &StageConfig, params: &PhysicalParams, index: usize) -> String {
    format!(
        r#"damping="{}" frictionloss="{}" armature="{}""#,
        passive_damping(config, params, index),
        params.joint(Joint::Friction, index),
        params.joint(Joint::Armature, index),
    )
}

fn hand(out: &mut String, config: &StageConfig, params: &PhysicalParams) -> std::fmt::Result {
    let [back, up] = MOUNT;
    // The palm faces down and the fingers point into the keyboard: palm x is world -z, palm z is world -x.
    writeln!(out, r#"    <body name="palm" pos="{back} 0 {up}" xyaxes="0 0 -1 0 -1 0">"#)?;
    writeln!(
        out,
        r#"      <joint name="rail" type="slide" axis="0 -1 0" range="{} {}" {}/>"#,
        -HALF_WIDTH,
        HALF_WIDTH,
        joint_attributes(config, params, RAIL),
    )?;
    let [sx, sy, sz] = PALM_SIZE.map(|s| s / 2.0);
    let [cx, cy, cz] = PALM_CENTRE;
    writeln!(
        out,
        r#"      <geom class="visual" type="box" pos="{cx} {cy} {cz}" size="{sx} {sy} {sz}" mass="{PALM_MASS}" rgba="0.2 0.2 0.22 1"/>"#
    )?;
    // The thumb is folded along the palm's far side: it adds its mass and touches nothing.
    let thumb = if root_side(config.side, 0) > 0.0 { 1.0 } else { -1.0 };
    writeln!(
        out,
        r#"      <geom class="visual" name="thumb" type="capsule" fromto="-0.018 {} -0.046 -0.018 {} 0.02" size="0.012" mass="{THUMB_MASS}" rgba="0.25 0.25 0.27 1"/>"#,
        thumb * 0.07,
        thumb * 0.075,
    )?;
    for (finger, name) in FINGER_NAMES.iter().enumerate() {
        self::finger(out, config, params, finger, name)?;
    }
    writeln!(out, r#"    </body>"#)
}

fn finger(
    out: &mut String,
    config: &StageConfig,
    params: &PhysicalParams,
    finger: usize,
    name: &str,
) -> std::fmt::Result {
    let side = root_side(config.side, finger);
    let outer = side != 0.0;
    let z = ROOT_Z[usize::from(!outer)];
    let half = -side * SPLAY / 2.0;
    let (sx, sy) = (LINK_SECTION[0] / 2.0, LINK_SECTION[1] / 2.0);
    let neighbour = if outer {
        format!(r#"contype="{TOUCHES_NEIGHBOUR}" conaffinity="0""#)
    } else {
        format!(r#"contype="0" conaffinity="{TOUCHES_NEIGHBOUR}""#)
    };
    let both = if outer {
        format!(r#"contype="{}" conaffinity="0""#, TOUCHES_KEYBOARD | TOUCHES_NEIGHBOUR)
    } else {
        format!(r#"contype="{TOUCHES_KEYBOARD}" conaffinity="{TOUCHES_NEIGHBOUR}""#)
    };
    let joint = |number: usize, axis: &str| {
        let [low, high] = FINGER_RANGE[number];
        format!(
            r#"<joint name="{name}_{number}" type="hinge" axis="{axis}" range="{low} {high}" {}/>"#,
            joint_attributes(config, params, finger * FINGER_JOINTS + number)
        )
    };
    let link = |part: &str, length: f64, mass: f64, contact: &str| {
        format!(
            r#"<geom name="{name}_{part}" type="box" pos="0 0 {}" size="{sx} {sy} {}" mass="{mass}" rgba="0.3 0.3 0.33 1" {contact}/>"#,
            length / 2.0,
            length / 2.0,
        )
    };
    writeln!(
        out,
        r#"      <body name="{name}_base" pos="0 {} {z}" quat="{} {} 0 0">"#,
        side * ROOT_SPACING,
        half.cos(),
        half.sin(),
    )?;
    writeln!(out, "        {}", joint(0, "0 0 1"))?;
    writeln!(out, "        {}", link("base", LINKS[0], LINK_MASSES[0], r#"class="visual""#))?;
    writeln!(out, r#"        <body name="{name}_proximal" pos="0 0 {}">"#, LINKS[0])?;
    writeln!(out, "          {}", joint(1, "0 1 0"))?;
    writeln!(out, "          {}", link("proximal", LINKS[1], LINK_MASSES[1], &neighbour))?;
    writeln!(out, r#"          <body name="{name}_medial" pos="0 0 {}">"#, LINKS[1])?;
    writeln!(out, "            {}", joint(2, "0 1 0"))?;
    writeln!(out, "            {}", link("medial", LINKS[2], LINK_MASSES[2], &both))?;
    writeln!(out, r#"            <body name="{name}_distal" pos="0 0 {}">"#, LINKS[2])?;
    writeln!(out, "              {}", joint(3, "0 1 0"))?;
    writeln!(out, "              {}", link("distal", DISTAL_LENGTH, LINK_MASSES[3], &both))?;
    writeln!(
        out,
        r#"              <geom name="{name}_tip" type="capsule" pos="0 0 {TIP_CENTRE}" size="{TIP_RADIUS} {TIP_HALF_LENGTH}" mass="{}" rgba="0.95 0.95 0.9 1" {both}/>"#,
        LINK_MASSES[4],
    )?;
    writeln!(
        out,
        r#"              <site name="{name}_tip" pos="0 0 {}" size="0.003"/>"#,
        TIP_CENTRE + TIP_HALF_LENGTH
    )?;
    writeln!(out, r#"              <site name="{name}_pad" pos="0 0 {PAD}" size="0.003"/>"#)?;
    for indent in ["            ", "          ", "        ", "      "] {
        writeln!(out, "{indent}</body>")?;
    }
    Ok(())
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
        assert_eq!(lines.len(), 1 + KEYS, "the keyboard's body and each key's");
        assert!(lines.iter().all(|(_, line)| line.contains("<body name=\"key") && line.contains("quat=")));

        let mut keys = ModelOptions::default().keys;
        keys[7] = KeyFactors { stiffness: 2.0, travel: 0.5 };
        let other_key = text(&ModelOptions { keys, ..ModelOptions::default() });
        let lines = differing(&simulators, &other_key);
        assert_eq!(lines.len(), 1);
        let stop = KeyShape::of(7).max_angle() / 2.0;
        assert!(lines[0].1.contains(&format!(r#"{stop}" stiffness="2""#)), "{}", lines[0].1);

        let firm = text(&ModelOptions { firm_joints: true, ..ModelOptions::default() });
        assert_eq!(firm.lines().count(), simulators.lines().count() + 1);
        assert!(firm.contains("solreflimit") && !simulators.contains("solreflimit"));
    }
}
