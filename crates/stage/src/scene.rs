//! The world as shapes on a kinematic tree, to draw it without MuJoCo.

use mujoco_rs::prelude::{MjtJoint, MjtObjBase};
use mujoco_rs::wrappers::mj_model::MjtGeomBase as MjtGeom;
use serde::{Deserialize, Serialize};

use crate::geometry::KeyShape;
use crate::hand::JOINT_NAMES;
use crate::visual_geoms::{VisualGeom, visual_geoms};
use crate::world::World;

/// Bodies, each after its parent, and the shapes attached to them. Lengths in m, angles in rad,
/// MuJoCo's conventions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The bodies.
    pub bodies: Vec<SceneBody>,
    /// The shapes.
    pub geoms: Vec<SceneGeom>,
}

/// A body: a frame that its joint moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneBody {
    /// Its name.
    pub name: String,
    /// Index of its parent; −1 is the world.
    pub parent: i32,
    /// Place in the parent's frame.
    pub pos: [f64; 3],
    /// Orientation in the parent's frame, `[w, x, y, z]`.
    pub quat: [f64; 4],
    /// The joint that moves it.
    pub joint: Option<SceneJoint>,
}

/// A joint, in the frame of its body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneJoint {
    /// `hinge` or `slide`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Direction of its axis.
    pub axis: [f64; 3],
    /// A point on its axis.
    pub anchor: [f64; 3],
    /// Index among the driven joints; absent for a key.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drive: Option<usize>,
    /// Number of the key; absent for a driven joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<usize>,
    /// Angle of a key at its lower stop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub down: Option<f64>,
}

/// A shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneGeom {
    /// Its name; empty for most shapes without contacts.
    pub name: String,
    /// Index of its body; −1 is the world.
    pub body: i32,
    /// `box`, `capsule`, `cylinder`, `ellipsoid` or `sphere`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Half sizes of a box; radius and half length (along z) of a capsule or cylinder; radius of a
    /// sphere; half axes of an ellipsoid.
    pub size: [f64; 3],
    /// Place in the body's frame.
    pub pos: [f64; 3],
    /// Orientation in the body's frame, `[w, x, y, z]`.
    pub quat: [f64; 4],
    /// Colour and opacity, 0 to 1.
    pub rgba: [f32; 4],
}

impl World {
    /// The world as shapes: those of MuJoCo's model in its order, then those that are drawn only.
    pub fn scene(&self) -> Scene {
        let model = self.data().model();
        let name = |name: Option<&str>| name.unwrap_or_default().to_string();
        // Body 0 is the world itself, so every index is one less than MuJoCo's.
        let bodies = (1..model.body_parentid().len()).map(|body| SceneBody {
            name: name(model.id_to_name(MjtObjBase::mjOBJ_BODY, body)),
            parent: model.body_parentid()[body] - 1,
            pos: model.body_pos()[body],
            quat: model.body_quat()[body],
            joint: usize::try_from(model.body_jntadr()[body]).ok().map(|joint| {
                let joint_name = name(model.id_to_name(MjtObjBase::mjOBJ_JOINT, joint));
                let key = joint_name.strip_prefix("key_").and_then(|number| number.parse().ok());
                SceneJoint {
                    kind: match model.jnt_type()[joint] {
                        MjtJoint::mjJNT_SLIDE => "slide",
                        _ => "hinge",
                    }
                    .to_string(),
                    axis: model.jnt_axis()[joint],
                    anchor: model.jnt_pos()[joint],
                    drive: JOINT_NAMES.iter().position(|name| *name == joint_name),
                    key,
                    down: key.map(|key| KeyShape::of(key).max_angle()),
                }
            }),
        });
        let geoms = (0..model.geom_type().len()).map(|geom| SceneGeom {
            name: name(model.id_to_name(MjtObjBase::mjOBJ_GEOM, geom)),
            body: model.geom_bodyid()[geom] - 1,
            kind: match model.geom_type()[geom] {
                MjtGeom::mjGEOM_CAPSULE => "capsule",
                MjtGeom::mjGEOM_CYLINDER => "cylinder",
                MjtGeom::mjGEOM_SPHERE => "sphere",
                _ => "box",
            }
            .to_string(),
            size: model.geom_size()[geom],
            pos: model.geom_pos()[geom],
            quat: model.geom_quat()[geom],
            rgba: model.geom_rgba()[geom],
        });
        Scene { bodies: bodies.collect(), geoms: geoms.chain(self.visual_geoms()).collect() }
    }

    /// The shapes that are drawn and are not in MuJoCo's model: motors, the thumb's tip, the rail.
    pub fn visual_geoms(&self) -> Vec<SceneGeom> {
        let model = self.data().model();
        let shape = |geom: VisualGeom| {
            let id = model.name_to_id(MjtObjBase::mjOBJ_BODY, &geom.body);
            SceneGeom {
                name: geom.name.to_string(),
                body: id.map_or(-1, |id| id as i32 - 1),
                kind: geom.kind.to_string(),
                size: geom.size,
                pos: geom.pos,
                quat: geom.quat,
                rgba: geom.rgba,
            }
        };
        visual_geoms(self.config()).into_iter().map(shape).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DRIVEN_JOINTS, PhysicalParams, StageConfig};
    use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

    fn frame(pos: [f64; 3], [w, x, y, z]: [f64; 4]) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Isometry3::from_parts(Translation3::from(pos), turn)
    }

    /// Forward kinematics as documented at `Scene` puts every shape where MuJoCo has it.
    #[test]
    fn shapes_are_where_mujoco_has_them() {
        let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let mut pose: [f64; DRIVEN_JOINTS] = std::array::from_fn(|joint| 0.1 + 0.02 * joint as f64);
        pose[crate::RAIL] = -0.13;
        let down = etude_music::KeySet::from_pitches([60, 61]);
        world.pose(&pose, down);
        let scene = world.scene();
        let mut frames: Vec<Isometry3<f64>> = Vec::new();
        for body in &scene.bodies {
            let parent = usize::try_from(body.parent).map_or(Isometry3::identity(), |parent| frames[parent]);
            let motion = body.joint.as_ref().map_or(Isometry3::identity(), |joint| {
                let angle = match (joint.drive, joint.key, joint.down) {
                    (Some(drive), _, _) => pose[drive],
                    (None, Some(key), Some(angle)) if down.contains(key) => angle,
                    _ => 0.0,
                };
                let (axis, anchor) = (Vector3::from(joint.axis), Translation3::from(joint.anchor));
                if joint.kind == "slide" {
                    Isometry3::translation(axis.x * angle, axis.y * angle, axis.z * angle)
                } else {
                    let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), angle);
                    anchor * Isometry3::from_parts(Translation3::identity(), turn) * anchor.inverse()
                }
            });
            frames.push(parent * frame(body.pos, body.quat) * motion);
        }
        assert_eq!(scene.bodies.iter().filter(|body| body.joint.is_some()).count(), DRIVEN_JOINTS + 49);
        let in_model = world.data().geom_xpos().len();
        let drawn = &scene.geoms[in_model..];
        let finger = scene.bodies.iter().position(|body| body.name == "ring_distal").unwrap() as i32;
        assert!(drawn.iter().any(|geom| geom.body == finger), "every finger has its motors");
        assert_eq!(drawn.iter().filter(|geom| geom.body < 0).count(), 1, "only the rail stands in the world");
        for (index, geom) in scene.geoms[..in_model].iter().enumerate() {
            let place = frames[geom.body as usize] * frame(geom.pos, geom.quat);
            let [x, y, z] = world.data().geom_xpos()[index];
            let off = (place.translation.vector - Vector3::new(x, y, z)).norm();
            assert!(off < 1e-9, "{} is {off} m off", geom.name);
            // MuJoCo's matrices are row by row.
            let turn = place.rotation.to_rotation_matrix();
            let theirs = world.data().geom_xmat()[index];
            let turned = (0..9).all(|cell| (turn[(cell / 3, cell % 3)] - theirs[cell]).abs() < 1e-9);
            assert!(turned, "{} points another way", geom.name);
        }
    }
}
