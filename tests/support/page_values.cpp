#include "tests/support/page_values.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>

namespace kiln::test {

PageValues read_page(const std::filesystem::path& path) {
  Imf::InputFile file(path.c_str(), 0);
  const auto box = file.header().dataWindow();
  PageValues page;
  page.width = std::uint32_t(box.max.x - box.min.x + 1);
  page.height = std::uint32_t(box.max.y - box.min.y + 1);
  Imf::FrameBuffer frame;
  const Imf::ChannelList& list = file.header().channels();
  for (auto c = list.begin(); c != list.end(); ++c) {
    auto& values = page.channels[c.name()];
    values.resize(std::size_t(page.width) * page.height);
    frame.insert(c.name(), Imf::Slice::Make(Imf::FLOAT, values.data(), box.min, page.width,
                                            page.height, sizeof(float)));
  }
  file.setFrameBuffer(frame);
  file.readPixels(box.min.y, box.max.y);
  return page;
}

}  // namespace kiln::test
