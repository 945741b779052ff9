//! The step loop does not allocate on Rust's heap (what MuJoCo does with its own is not seen),
//! asserted by an allocator that counts.
#![allow(unsafe_code)] // A global allocator is unsafe by its nature; this one hands everything on.
#![allow(clippy::unwrap_used)] // Helpers of tests are tests too, which clippy.toml does not see.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use etude_learn::{StepBatch, VectorEnvironment as _};
use etude_music::repertoire;
use etude_task::{ACTION_LEN, PianoVectorEnv, Piece, ScriptedBaseline, TaskConfig};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

struct Counting;

static CALLS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn steps_and_restarts_do_not_allocate() {
    let mut drawn = TaskConfig::default();
    drawn.randomisation.intensity = 0.5;
    let fingered = TaskConfig { fingering: true, ..drawn.clone() };
    for config in [TaskConfig::default(), drawn, fingered] {
        do_not_allocate(&config);
    }
    assert!(CALLS.load(Ordering::Relaxed) > 0, "the counter does not count");
}

fn do_not_allocate(config: &TaskConfig) {
    let song = repertoire::get("twinkle").expect("built in");
    let piece = Piece::for_task(&song, config).unwrap();
    let num_envs = 3;
    let mut vector = PianoVectorEnv::new(config, &piece, num_envs, 0).unwrap();
    let player = ScriptedBaseline::new(config, &piece).unwrap();
    let mut batch = StepBatch::new(num_envs, vector.layout(), vector.reward_term_names().len());
    let mut random = Pcg64::seed_from_u64(0);
    let mut actions = vec![0.0; num_envs * ACTION_LEN];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    pool.install(|| {
        vector.reset(&mut batch.observation);
        // The first episode may warm up what is kept.
        let mut before = 0;
        let (mut restarts, steps) = (0, piece.steps());
        for step in 0..4 * steps {
            if step == steps + 1 {
                before = CALLS.load(Ordering::Relaxed);
            }
            actions.chunks_mut(ACTION_LEN).for_each(|row| row.copy_from_slice(&player.action(step % steps)));
            actions.iter_mut().for_each(|action| *action += random.random_range(-0.5..=0.5));
            vector.step(&actions, &mut batch);
            restarts += usize::from(batch.truncated[0]);
        }
        assert_eq!(restarts, 4);
        assert_eq!(CALLS.load(Ordering::Relaxed) - before, 0, "allocations in three episodes");
    });
}
