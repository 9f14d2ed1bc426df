#include "tests/bench/ball.h"

namespace kiln::bench {

const ReadyScene& ball_at_1024() {
  static const ReadyScene ready("cornell_geom", 91, 1024);
  return ready;
}

}  // namespace kiln::bench
