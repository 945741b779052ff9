//! Pictures of a world, drawn off-screen by MuJoCo through EGL: on a GPU, or on the processor with
//! Mesa.
#![allow(unsafe_code)] // Shapes that are drawn only are added to MuJoCo's scene; see the use.

use std::error::Error as _;

use mujoco_rs::prelude::MjvCamera;
use mujoco_rs::renderer::MjRenderer;
use mujoco_rs::wrappers::fun::utility::{mju_mul_quat, mju_quat_2_mat, mju_rot_vec_quat};
use mujoco_rs::wrappers::mj_model::MjtGeom;

use crate::hand::RAIL;
use crate::mjcf::{FIELD_OF_VIEW_DEG, MAX_PICTURE_SIZE};
use crate::scene::SceneGeom;
use crate::world::World;

/// A picture could not be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The size is not one that the model's buffer has room for.
    #[error("a picture of {0} × {1} pixels is not possible: at most {max_w} × {max_h}, at least 1 × 1",
        max_w = MAX_PICTURE_SIZE[0], max_h = MAX_PICTURE_SIZE[1])]
    Size(i64, i64),
    /// There is no OpenGL without a screen.
    #[error(
        "no off-screen OpenGL here ({0}): install EGL and Mesa's software renderer (Debian, Ubuntu: apt-get install -y \
         libegl1 libgl1-mesa-dri), or a GPU's driver; `etude replay` shows recordings without it"
    )]
    NoGl(String),
    /// Drawing failed on the way.
    #[error("drawing failed: {0}")]
    Draw(String),
}

/// Camera positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum View {
    /// Behind and above the hand, as a player sees the keys.
    Player,
    /// From the low end of the keyboard; moves with the hand.
    Side,
    /// From above.
    Top,
    /// Close to the fingers, from the player's side and so low that the palm hides no fingertip;
    /// moves with the hand.
    #[default]
    Fingers,
}

impl View {
    /// Every view.
    pub const ALL: [View; 4] = [View::Player, View::Side, View::Top, View::Fingers];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Player => "player",
            Self::Side => "side",
            Self::Top => "top",
            Self::Fingers => "fingers",
        }
    }

    /// The view of this name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|view| view.name() == name)
    }

    /// Point that the camera looks at, m; from there to the camera; width and height of what is
    /// seen there, m. They are those of the replay page (`viewer/src/cameras.js`).
    fn place(self, rail: f64) -> ([f64; 3], [f64; 3], [f64; 2]) {
        match self {
            Self::Player => ([0.03, 0.0, 0.03], [0.66, -0.09, 0.85], [0.76, 0.33]),
            Self::Side => ([0.03, rail, 0.06], [0.1, -1.0, 0.24], [0.34, 0.26]),
            Self::Top => ([0.03, 0.0, 0.03], [0.02, 0.0, 1.0], [0.76, 0.42]),
            Self::Fingers => ([0.03, rail, 0.055], [0.45, -0.8, 0.3], [0.3, 0.19]),
        }
    }
}

/// Largest number of shapes that are drawn besides those of the model.
const MAX_SHAPES: u32 = 128;

/// Draws pictures of worlds with one model.
pub struct Painter {
    renderer: MjRenderer,
    view: View,
    /// Width over height.
    aspect: f64,
}

/// Width and height of a picture, pixels, if one of that size can be drawn.
///
/// # Errors
/// [`PictureError::Size`] if not.
pub fn picture_size(width: i64, height: i64) -> Result<[u32; 2], PictureError> {
    let fit = |size: i64, most: u32| u32::try_from(size).ok().filter(|size| (1..=most).contains(size));
    match (fit(width, MAX_PICTURE_SIZE[0]), fit(height, MAX_PICTURE_SIZE[1])) {
        (Some(width), Some(height)) => Ok([width, height]),
        _ => Err(PictureError::Size(width, height)),
    }
}

impl Painter {
    /// A painter of pictures with `width` × `height` pixels. Smooth edges take twice as long where
    /// the processor draws.
    ///
    /// # Errors
    /// If the size is out of range or there is no OpenGL.
    pub fn new(
        world: &mut World,
        [width, height]: [u32; 2],
        view: View,
        smooth: bool,
    ) -> Result<Self, PictureError> {
        picture_size(width.into(), height.into())?;
        // MuJoCo clears and resolves the whole buffer for each picture.
        // SAFETY: only values change; no size, address or id table is touched.
        let visual = unsafe { world.data.model_mut() }.vis_mut();
        (visual.global.offwidth, visual.global.offheight) = (width as i32, height as i32);
        visual.quality.offsamples = if smooth { 4 } else { 0 };
        let model = world.data.model();
        let camera = MjvCamera::new_free(model);
        let renderer = MjRenderer::builder()
            .width(width)
            .height(height)
            .num_visual_user_geom(MAX_SHAPES)
            .camera(camera)
            .build(model);
        let renderer = renderer.map_err(|error| {
            let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
            PictureError::NoGl(cause)
        })?;
        Ok(Self { renderer, view, aspect: f64::from(width) / f64::from(height) })
    }

    /// A picture of the world as it stands, with `shapes` on its bodies: rows from top to bottom,
    /// three bytes (red, green, blue) a pixel.
    ///
    /// # Errors
    /// If drawing fails.
    pub fn paint(&mut self, world: &mut World, shapes: &[SceneGeom]) -> Result<&[u8], PictureError> {
        let fail = |error: mujoco_rs::renderer::RendererError| PictureError::Draw(error.to_string());
        self.aim(world.joints()[RAIL]);
        // Shadows take as long as all else together where the processor draws.
        // SAFETY: only values change; no size, address or id table is touched.
        unsafe { world.data.model_mut() }.light_castshadow_mut().fill(false);
        self.renderer.sync_data(&mut world.data).map_err(fail)?;
        let scene = self.renderer.user_scene_mut();
        scene.clear_geom();
        for shape in shapes {
            let body = (shape.body + 1) as usize;
            let (at, turn) = (world.data.xpos()[body], world.data.xquat()[body]);
            let (mut pos, mut quat, mut matrix) = ([0.0; 3], [0.0; 4], [0.0; 9]);
            mju_rot_vec_quat(&mut pos, &shape.pos, &turn);
            mju_mul_quat(&mut quat, &turn, &shape.quat);
            mju_quat_2_mat(&mut matrix, &quat);
            let pos = std::array::from_fn(|axis| at[axis] + pos[axis]);
            let kind = match shape.kind.as_str() {
                "capsule" => MjtGeom::mjGEOM_CAPSULE,
                "cylinder" => MjtGeom::mjGEOM_CYLINDER,
                "ellipsoid" => MjtGeom::mjGEOM_ELLIPSOID,
                "sphere" => MjtGeom::mjGEOM_SPHERE,
                _ => MjtGeom::mjGEOM_BOX,
            };
            // SAFETY: these kinds refer to no mesh, texture or other element of the model.
            let made = unsafe {
                scene.try_create_geom(kind, Some(shape.size), Some(pos), Some(matrix), Some(shape.rgba))
            };
            made.map_err(|error| PictureError::Draw(error.to_string()))?;
        }
        self.renderer.render().map_err(fail)?;
        Ok(self.renderer.rgb_flat().unwrap_or_default())
    }

    /// Points the camera, and moves it so far away that the view's width and height are seen.
    fn aim(&mut self, rail: f64) {
        let (lookat, [x, y, z], [width, height]) = self.view.place(rail);
        let tangent = (FIELD_OF_VIEW_DEG / 2.0).to_radians().tan();
        let camera = self.renderer.camera_mut();
        camera.lookat = lookat;
        camera.distance = (height / (2.0 * tangent)).max(width / (2.0 * tangent * self.aspect));
        // MuJoCo's angles are those of the line of sight.
        camera.azimuth = (-y).atan2(-x).to_degrees();
        camera.elevation = -z.atan2(x.hypot(y)).to_degrees();
    }
}
