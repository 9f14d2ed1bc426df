#pragma once

// The one way in which this project includes tinygltf: without its file access and its image
// decoder, so that nothing it meets in a document can make it open or decode anything. For .cpp
// files only.
#define TINYGLTF_NO_FS
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>
