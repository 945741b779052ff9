//! Where joints, keys and geoms are in the MuJoCo model: names are resolved to ids once, when a
//! world is built.

use etude_music::KEY_COUNT;
use mujoco_rs::prelude::{MjModel, MjtObjBase};

use crate::contacts::ContactPart;
use crate::error::StageError;
use crate::hand::{DRIVEN_JOINTS, FINGER_NAMES, FINGERS, JOINT_NAMES};

/// Ids and addresses in the MuJoCo model.
#[derive(Clone)]
pub(super) struct Layout {
    pub keyboard: usize,
    pub palm: usize,
    pub key_dof: [usize; KEY_COUNT],
    pub key_tree: [usize; KEY_COUNT],
    pub key_body: [usize; KEY_COUNT],
    pub key_geom: [usize; KEY_COUNT],
    pub joint_dof: [usize; DRIVEN_JOINTS],
    pub tip_site: [usize; FINGERS],
    pub pad_site: [usize; FINGERS],
    pub geom_part: Vec<ContactPart>,
}

fn id(model: &MjModel, kind: MjtObjBase, name: &str) -> Result<usize, StageError> {
    model.name_to_id(kind, name).ok_or_else(|| StageError::Missing(name.to_string()))
}

impl Layout {
    pub(super) fn new(model: &MjModel) -> Result<Self, StageError> {
        // Every joint has one degree of freedom, so joint id, position and velocity address are one
        // number.
        let dof = |name: &str| id(model, MjtObjBase::mjOBJ_JOINT, name);
        let mut layout = Self {
            keyboard: id(model, MjtObjBase::mjOBJ_BODY, "keyboard")?,
            palm: id(model, MjtObjBase::mjOBJ_BODY, "palm")?,
            key_dof: [0; KEY_COUNT],
            key_tree: [0; KEY_COUNT],
            key_body: [0; KEY_COUNT],
            key_geom: [0; KEY_COUNT],
            joint_dof: [0; DRIVEN_JOINTS],
            tip_site: [0; FINGERS],
            pad_site: [0; FINGERS],
            geom_part: vec![ContactPart::OtherLink; model.geom_friction().len()],
        };
        for key in 0..KEY_COUNT {
            layout.key_dof[key] = dof(&format!("key_{key}"))?;
            // A key is never fixed, so it has a tree.
            layout.key_tree[key] = model.dof_treeid()[layout.key_dof[key]] as usize;
            layout.key_body[key] = id(model, MjtObjBase::mjOBJ_BODY, &format!("key_{key}"))?;
            layout.key_geom[key] = id(model, MjtObjBase::mjOBJ_GEOM, &format!("key_{key}"))?;
        }
        for (slot, name) in layout.joint_dof.iter_mut().zip(JOINT_NAMES) {
            *slot = dof(name)?;
        }
        for (finger, name) in FINGER_NAMES.iter().enumerate() {
            layout.tip_site[finger] = id(model, MjtObjBase::mjOBJ_SITE, &format!("{name}_tip"))?;
            layout.pad_site[finger] = id(model, MjtObjBase::mjOBJ_SITE, &format!("{name}_pad"))?;
        }
        for geom in 0..layout.geom_part.len() {
            let name = model.id_to_name(MjtObjBase::mjOBJ_GEOM, geom).unwrap_or_default();
            layout.geom_part[geom] = ContactPart::of(name);
        }
        Ok(layout)
    }
}
