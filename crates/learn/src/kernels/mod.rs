//! The arithmetic: matrix products by the `gemm` crate or, in bfloat16, by a kernel of our own;
//! everything between them as fused loops.
//!
//! Each elementwise kernel is written once as a plain loop and compiled three times (AVX-512, AVX2
//! with FMA, and the target's baseline, which on aarch64 is NEON); the widest one that the
//! processor has is chosen at run time. On one machine a kernel always gives the same bytes.
//! Between machines of different vector width the last bit may differ, and products in bfloat16 are
//! those of f32 where the processor has none.

mod adam;
mod bf16;
mod dense;
mod gelu;
mod math;
mod norm;
mod reduce;
mod sparse;

pub(crate) use adam::{AdamStep, adam, adam_polyak};
pub(crate) use bf16::Bf16Products;
pub use bf16::available as bf16_available;
#[cfg(test)]
pub(crate) use bf16::tests::products_or_skip;
pub(crate) use dense::{Matrix, add_row, column_sums, product};
pub(crate) use gelu::{bias_gelu, multiply};
pub(crate) use math::{exp_in_place, squash};
pub(crate) use norm::{norm_backward, norm_forward};
pub(crate) use sparse::{gather_rows, scatter_rows};

/// Number of independent partial sums in a reduction: one AVX-512 register.
pub(crate) const LANES: usize = 16;

/// `a * b + c`, in one rounding where the hardware has it. Elsewhere `mul_add` would be a slow
/// library call.
#[inline(always)]
fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[allow(dead_code)] // Which variants occur depends on the architecture.
enum Level {
    Baseline,
    Avx2,
    Avx512,
}

#[cfg(test)]
thread_local! {
    /// Lets a test run a narrower copy than the processor's widest.
    static AT_MOST: std::cell::Cell<Level> = const { std::cell::Cell::new(Level::Avx512) };
}

/// Runs `test` on this thread with every kernel's copy of at most each level.
#[cfg(test)]
pub(crate) fn at_every_level(test: impl Fn()) {
    for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
        AT_MOST.set(level);
        test();
    }
}

#[cfg(target_arch = "x86_64")]
fn level() -> Level {
    #[cfg(test)]
    return widest().min(AT_MOST.get());
    #[cfg(not(test))]
    widest()
}

#[cfg(target_arch = "x86_64")]
fn widest() -> Level {
    use std::sync::OnceLock;
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        let avx2 = std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
        let avx512 = std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
            && std::arch::is_x86_feature_detected!("avx512dq")
            && std::arch::is_x86_feature_detected!("avx512bw");
        match (avx2, avx512) {
            (true, true) => Level::Avx512,
            (true, false) => Level::Avx2,
            (false, _) => Level::Baseline,
        }
    })
}

#[cfg(not(target_arch = "x86_64"))]
fn level() -> Level {
    Level::Baseline
}

/// Defines a kernel: `fn name(args) { loop }` becomes a function that picks the widest compiled
/// copy of the loop. The body may use the constants `FMA` and `WIDE` (AVX-512).
macro_rules! kernel {
    ($(#[$attribute:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$attribute])*
        #[allow(clippy::too_many_arguments)]
        pub(crate) fn $name($($argument: $type),*) {
            #[inline(always)]
            #[allow(clippy::too_many_arguments)]
            fn body<const FMA: bool, const WIDE: bool>($($argument: $type),*) $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
            #[allow(clippy::too_many_arguments)]
            fn avx512($($argument: $type),*) {
                body::<true, true>($($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            #[allow(clippy::too_many_arguments)]
            fn avx2($($argument: $type),*) {
                body::<true, false>($($argument),*)
            }

            match crate::kernels::level() {
                // SAFETY: `level` returns this only after it has seen every feature that the copy
                // was compiled for.
                #[cfg(target_arch = "x86_64")]
                crate::kernels::Level::Avx512 => unsafe { avx512($($argument),*) },
                // SAFETY: likewise.
                #[cfg(target_arch = "x86_64")]
                crate::kernels::Level::Avx2 => unsafe { avx2($($argument),*) },
                _ => body::<{ cfg!(target_arch = "aarch64") }, false>($($argument),*),
            }
        }
    };
}
use kernel;
