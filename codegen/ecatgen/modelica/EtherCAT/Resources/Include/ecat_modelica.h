/* What the Modelica library EtherCAT calls: the objects of a model and their life. What they do with the
 * bus is in the client (ecat_session.h), for FMUs as well; here is what Modelica makes of it.
 *
 * Valid C89, static functions only: a Modelica tool may put every external function into a
 * translation unit of its own. So nothing here is shared through global variables; an orphan (older
 * FMU exporters call a constructor twice) costs memory and nothing else, because outputs are claimed
 * by the first commit and not by a constructor.
 *
 *     time t:  wait -> reads -> the model -> writes -> commit
 *
 * Tools may evaluate a when-clause more than once at one time. Hence: the first call at a new time
 * takes the sample, all reads at that time see it; a write only remembers its value, the last commit
 * of the slaves of a domain hands all of them over at once, and doing so twice is harmless.
 *
 * A model may live without a bus: constructors note what they stand for, and the session looks all of it up
 * when there is a bus, and again when that has come back.
 *
 * The master owns the memory of all objects, so that they may be destroyed in any order.
 * ModelicaFormatError() does not return; nothing may be held that no object owns when it is called.
 */
#ifndef ECAT_MODELICA_H
#define ECAT_MODELICA_H

#include "ecatm_drive_steps.h"
#include "ecatm_generate.h"
#include "ecatm_master.h"
#include "ecatm_objects.h"
#include "ecatm_outputs.h"
#include "ecatm_realtime.h"
#include "ecatm_samples.h"
#include "ecatm_sdo.h"
#include "ecatm_sdo_list.h"
#include "ecatm_sdo_once.h"

#endif
