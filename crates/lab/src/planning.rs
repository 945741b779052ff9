//! Planning a fingering, and its progress. The planning is deep inside the start of a training or a performance, and only a long song
//! needs its progress; so the listener belongs to the thread while its work runs, and is not passed down as an argument.

use std::cell::RefCell;
use std::rc::Rc;

use etude_music::Song;
use etude_task::{Piece, TaskConfig, TaskError};

type Listener = Rc<RefCell<dyn FnMut(f64)>>;

thread_local! {
    static LISTENERS: RefCell<Vec<Listener>> = const { RefCell::new(Vec::new()) };
    /// The last plan. A command plans one song to choose its policy, to warn of what is left out, and to play it.
    static LAST: RefCell<Option<(Song, TaskConfig, Piece)>> = const { RefCell::new(None) };
}

/// Removes the listener also if the work panics.
struct Listening;

impl Drop for Listening {
    fn drop(&mut self) {
        LISTENERS.with_borrow_mut(Vec::pop);
    }
}

/// Does `work`; what it plans in this thread tells `listener` the share that is planned, 0 to 1.
pub fn planning_told<T>(listener: impl FnMut(f64) + 'static, work: impl FnOnce() -> T) -> T {
    LISTENERS.with_borrow_mut(|listeners| listeners.push(Rc::new(RefCell::new(listener))));
    let _listening = Listening;
    work()
}

/// Tells the listener of this thread, if there is one, the share that is planned.
pub(crate) fn tell_planning() -> impl FnMut(f64) {
    let listener = LISTENERS.with_borrow(|listeners| listeners.last().cloned());
    move |share| {
        if let Some(listener) = &listener {
            listener.borrow_mut()(share);
        }
    }
}

/// [`Piece::for_task`], heard by the listener if there is one.
pub(crate) fn plan(song: &Song, task: &TaskConfig) -> Result<Piece, TaskError> {
    plan_telling(song, task, &mut tell_planning())
}

/// [`Piece::for_task_with_progress`]; what this thread has planned last is not planned again.
pub(crate) fn plan_telling(
    song: &Song,
    task: &TaskConfig,
    tell: &mut dyn FnMut(f64),
) -> Result<Piece, TaskError> {
    let is_same = |(of, by, _): &&(Song, TaskConfig, Piece)| of == song && by == task;
    if let Some(piece) = LAST.with_borrow(|last| Some(last.as_ref().filter(is_same)?.2.clone())) {
        return Ok(piece);
    }
    let piece = Piece::for_task_with_progress(song, task, tell)?;
    LAST.set(Some((song.clone(), task.clone(), piece.clone())));
    Ok(piece)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_innermost_listener_hears_the_planning_of_its_own_work() {
        let task = crate::resolve(crate::DEFAULT_PRESET, None, &[]).unwrap().task;
        let song = etude_music::repertoire::get("twinkle").unwrap();
        let heard = Rc::new(RefCell::new(Vec::new()));
        let listener = |heard: &Rc<RefCell<Vec<f64>>>| {
            let heard = heard.clone();
            move |share| heard.borrow_mut().push(share)
        };
        let outer = Rc::new(RefCell::new(Vec::new()));
        planning_told(listener(&outer), || {
            planning_told(listener(&heard), || plan(&song, &task).unwrap());
            assert!(outer.borrow().is_empty());
        });
        let before = heard.borrow().len();
        assert!(before > 0 && heard.borrow().iter().all(|share| (0.0..=1.0).contains(share)));
        plan(&etude_music::repertoire::get("ode-to-joy").unwrap(), &task).unwrap();
        assert_eq!(heard.borrow().len(), before);
    }

    #[test]
    fn a_plan_is_made_again_for_another_song_or_task_alone() {
        let task = crate::resolve(crate::DEFAULT_PRESET, None, &[]).unwrap().task;
        let [twinkle, scale] =
            ["twinkle", "c-major-scale"].map(|id| etude_music::repertoire::get(id).unwrap());
        let slow = TaskConfig { change_steps: task.change_steps + 1, ..task.clone() };
        let mut calls = 0;
        let mut is_planned = |song: &Song, task: &TaskConfig| {
            let before = calls;
            let piece = plan_telling(song, task, &mut |_| calls += 1).unwrap();
            let anew = Piece::for_task(song, task).unwrap();
            assert_eq!((piece.frames(), piece.planned()), (anew.frames(), anew.planned()));
            calls > before
        };
        assert!(is_planned(&twinkle, &task) && !is_planned(&twinkle, &task));
        assert!(is_planned(&scale, &task) && is_planned(&scale, &slow) && !is_planned(&scale, &slow));
        assert!(is_planned(&twinkle, &task));
    }
}
