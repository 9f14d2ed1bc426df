#include "tests/bench/ball.h"

namespace kiln::bench {

const ReadyScene& ball_at_1024() {
  static const ReadyScene ready("bumpy_ball", 91, 1024);
  return ready;
}

}  // namespace kiln::bench
