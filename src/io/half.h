// Half floats are shared with the model file.
#pragma once

#include "base/half.h"
