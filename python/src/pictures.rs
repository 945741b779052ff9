//! Pictures of environments. A painter belongs to the thread that made it, and serves all worlds
//! built alike.

use std::cell::RefCell;

use etude_stage::{Painter, SceneGeom, StageConfig, View, World, picture_size};
use pyo3::PyResult;

use crate::error;

/// Painters of a thread: each has its own buffers.
const MAX_STUDIOS: usize = 4;

/// A world to draw, and its painter.
struct Studio {
    stage: StageConfig,
    size: [u32; 2],
    view: View,
    world: World,
    shapes: Vec<SceneGeom>,
    painter: Painter,
}

thread_local! {
    static STUDIOS: RefCell<Vec<Studio>> = const { RefCell::new(Vec::new()) };
}

impl Studio {
    fn new(like: &World, size: [u32; 2], view: View) -> PyResult<Self> {
        let mut world = World::new(like.config(), like.params()).map_err(error)?;
        let painter = Painter::new(&mut world, size, view, true).map_err(error)?;
        let shapes = world.visual_geoms();
        Ok(Self { stage: like.config().clone(), size, view, world, shapes, painter })
    }
}

/// Size in pixels and view of a picture, from what Python gives.
pub(crate) fn parse(width: i64, height: i64, view: &str) -> PyResult<([u32; 2], View)> {
    let names = View::ALL.map(View::name).join(", ");
    let view =
        View::of(view).ok_or_else(|| error(format!("there is no view `{view}`; there are: {names}")))?;
    Ok((picture_size(width, height).map_err(error)?, view))
}

/// A picture of `world` of `size` pixels: rows from top to bottom, three bytes a pixel.
pub(crate) fn paint(world: &World, size: [u32; 2], view: View) -> PyResult<Vec<u8>> {
    STUDIOS.with_borrow_mut(|studios| {
        let fits =
            |studio: &Studio| studio.stage == *world.config() && studio.size == size && studio.view == view;
        let index = match studios.iter().position(fits) {
            Some(index) => index,
            None => {
                studios.truncate(MAX_STUDIOS - 1);
                studios.insert(0, Studio::new(world, size, view)?);
                0
            }
        };
        let studio = &mut studios[index];
        studio.world.set_params(world.params());
        studio.world.restore(&world.snapshot()).map_err(error)?;
        Ok(studio.painter.paint(&mut studio.world, &studio.shapes).map_err(error)?.to_vec())
    })
}
