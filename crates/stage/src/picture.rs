//! Pictures of a world, drawn off-screen by MuJoCo through EGL: on a GPU, or on the processor with Mesa.

use std::error::Error as _;

use mujoco_rs::prelude::MjvCamera;
use mujoco_rs::renderer::MjRenderer;

use crate::hand::RAIL;
use crate::mjcf::LARGEST_PICTURE;
use crate::world::World;

/// A picture could not be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The size is not one that the model's buffer has room for.
    #[error("a picture of {0} × {1} pixels is not possible: at most {max_w} × {max_h}, at least 1 × 1",
        max_w = LARGEST_PICTURE[0], max_h = LARGEST_PICTURE[1])]
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
    #[default]
    Player,
    /// From the low end of the keyboard.
    Side,
    /// From above.
    Top,
    /// Close to the fingers; moves with the hand.
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

    /// Point that the camera looks at, m; distance from it, m; azimuth and elevation in MuJoCo's convention, degrees.
    fn place(self, rail: f64) -> ([f64; 3], f64, [f64; 2]) {
        match self {
            Self::Player => ([0.0, 0.0, 0.04], 0.62, [180.0, -50.0]),
            Self::Side => ([0.02, 0.0, 0.06], 0.75, [100.0, -12.0]),
            Self::Top => ([0.02, 0.0, 0.03], 0.8, [180.0, -89.0]),
            Self::Fingers => ([0.03, rail, 0.05], 0.33, [145.0, -22.0]),
        }
    }
}

/// Draws pictures of worlds with one model.
pub struct Painter {
    renderer: MjRenderer,
    view: View,
}

/// Width and height of a picture, pixels, if one of that size can be drawn.
///
/// # Errors
/// [`PictureError::Size`] if not.
pub fn picture_size(width: i64, height: i64) -> Result<[u32; 2], PictureError> {
    let fit = |size: i64, most: u32| u32::try_from(size).ok().filter(|size| (1..=most).contains(size));
    match (fit(width, LARGEST_PICTURE[0]), fit(height, LARGEST_PICTURE[1])) {
        (Some(width), Some(height)) => Ok([width, height]),
        _ => Err(PictureError::Size(width, height)),
    }
}

impl Painter {
    /// A painter of pictures with `width` × `height` pixels.
    ///
    /// # Errors
    /// If the size is out of range or there is no OpenGL.
    pub fn new(world: &World, width: u32, height: u32, view: View) -> Result<Self, PictureError> {
        picture_size(width.into(), height.into())?;
        let model = world.data().model();
        let camera = MjvCamera::new_free(model);
        let renderer = MjRenderer::builder().width(width).height(height).camera(camera).build(model);
        let renderer = renderer.map_err(|error| {
            let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
            PictureError::NoGl(cause)
        })?;
        Ok(Self { renderer, view })
    }

    /// A picture of the world as it stands: rows from top to bottom, three bytes (red, green, blue) a pixel.
    ///
    /// # Errors
    /// If drawing fails.
    pub fn paint(&mut self, world: &mut World) -> Result<&[u8], PictureError> {
        let fail = |error: mujoco_rs::renderer::RendererError| PictureError::Draw(error.to_string());
        let (lookat, distance, [azimuth, elevation]) = self.view.place(world.joints()[RAIL]);
        let camera = self.renderer.camera_mut();
        (camera.lookat, camera.distance) = (lookat, distance);
        (camera.azimuth, camera.elevation) = (azimuth, elevation);
        self.renderer.sync_data(&mut world.data).map_err(fail)?;
        self.renderer.render().map_err(fail)?;
        Ok(self.renderer.rgb_flat().unwrap_or_default())
    }
}
