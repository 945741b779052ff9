//! MuJoCo's own window on a world, with contacts and joints. Needs the feature `viewer`.

use std::error::Error as _;

use mujoco_rs::viewer::{MjViewer, MjViewerError};

use crate::world::World;

/// The window cannot be opened or drawn.
#[derive(Debug, thiserror::Error)]
#[error(
    "no window: {0}; it needs a screen with OpenGL (DISPLAY or WAYLAND_DISPLAY). `etude render` and `etude replay` need none"
)]
pub struct WindowError(String);

fn fail(error: MjViewerError) -> WindowError {
    WindowError(error.source().map_or_else(|| error.to_string(), ToString::to_string))
}

/// An open window. It belongs to the main thread.
pub struct Window {
    viewer: MjViewer,
}

impl Window {
    /// Opens a window for worlds built like `world`.
    ///
    /// # Errors
    /// If there is no screen, or no OpenGL on it.
    pub fn open(world: &World) -> Result<Self, WindowError> {
        Ok(Self { viewer: MjViewer::launch_passive(world.data().model(), 0).map_err(fail)? })
    }

    /// Whether it has not been closed.
    pub fn is_open(&self) -> bool {
        self.viewer.running()
    }

    /// Draws the world, and handles mouse and keyboard input.
    ///
    /// # Errors
    /// If drawing fails.
    pub fn show(&mut self, world: &mut World) -> Result<(), WindowError> {
        self.viewer.sync_data(&mut world.data);
        self.viewer.render().map_err(fail)
    }
}
