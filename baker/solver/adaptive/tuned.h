#pragma once

/// The numbers of adaptive sampling that were tuned rather than derived. They decide how soon a
/// target is reached and how well the time left is foretold; the light that a sample brings does
/// not depend on them. scripts/bench measures a change of them: its results are the tables of
/// presets and of slopes in docs/performance.md.
namespace kiln::solver::adaptive::tuned {

// docs/how-it-works.md says what the measure percentile_95 counts.
/// Light is judged against itself plus this share of the scene's mean.
inline constexpr float kDarkShare = 0.02f;

// Table of slopes: many_lights without a filter has 0.65, other scenes 0.59 to 0.81.
/// Power of the number of samples with which the error falls, by which rounds are chosen.
inline constexpr double kSlope = 0.65;
/// The same power over all rounds together, for the estimate of the remaining time.
inline constexpr double kExpectedSlope = 0.47;

// Chosen by hand over the scenes of scripts/bench, so that few rounds follow and few samples are
// wasted; the single measurements were not kept.
/// A part of the light takes more samples where it has this share of the variance or more.
inline constexpr float kMinVarianceShare = 0.25f;
/// The most doublings of one round.
inline constexpr double kMostDoublings = 3;
/// A round by the measure rms aims this far below the target, so that no further round follows for
/// a small rest.
inline constexpr double kTargetMargin = 0.97;

// Means over the scenes of scripts/bench, for the first forecast only; the single measurements were
// not kept.
/// Share of the variance of direct light that the filter leaves, by few lights and by many.
inline constexpr double kLeftOfDirect = 0.25, kLeftOfManyLights = 0.1;
/// Share of the variance of gathered light that the filter leaves.
inline constexpr double kLeftOfGathered = 0.12;
/// The ratio of the error that counts in a tile to its mean.
inline constexpr double kAboveMean = 1.4;
/// The ratios of all indirect light to the direct, and to the first bounce.
inline constexpr double kIndirect = 0.8, kAllBounces = 1.7;
/// Error of a gather by 64 directions relative to what they bring, and the power with which it
/// falls.
inline constexpr double kGatherError = 0.1, kGatherErrorDirections = 64, kGatherErrorSlope = 0.7;
/// Share of the texels that may be above the target by the measure percentile_95.
inline constexpr double kMayBeAbove = 0.05;

}  // namespace kiln::solver::adaptive::tuned
