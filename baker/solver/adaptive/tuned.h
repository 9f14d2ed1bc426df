#pragma once

/// The numbers of adaptive sampling that were tuned rather than derived, with what they were read
/// from. They decide how soon a target is reached and how well the time left is told; the light
/// that a sample brings does not depend on them.
namespace kiln::solver::adaptive::tuned {

// docs/how-it-works.md, "Error": what the measure percentile_95 counts.
/// Light is judged against itself plus this share of the scene's mean.
inline constexpr float kDarkShare = 0.02f;

// docs/performance.md, table of slopes (scripts/bench, methods without a filter): 0.65 is the lower
// end over its scenes.
/// Power of the number of samples with which the error falls, by which rounds are chosen.
inline constexpr double kSlope = 0.65;
/// The same power over all rounds together, for the estimate of the remaining time.
inline constexpr double kExpectedSlope = 0.47;

// Chosen on the scenes of scripts/bench so that few rounds follow and few samples are wasted.
/// A part of the light takes more samples where it has this share of the variance or more.
inline constexpr float kMinVarianceShare = 0.25f;
/// The most doublings of one round.
inline constexpr double kMostDoublings = 3;
/// A round by the measure rms aims this far below the target, so that no further round follows for
/// a small rest.
inline constexpr double kTargetMargin = 0.97;

// Means over the scenes of scripts/bench, for the first forecast only.
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
